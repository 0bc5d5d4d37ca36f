"""Surfaces beside the strands, and how they reflect."""
