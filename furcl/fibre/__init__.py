"""Fibre scattering models, samplers of the offset h, and materials made of them."""
