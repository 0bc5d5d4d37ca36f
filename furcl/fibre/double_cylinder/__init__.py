"""The double cylinder: cuticle, cortex and a scattering medulla."""
