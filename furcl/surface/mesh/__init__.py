"""Meshes of triangles: read, checked, textured, and what kernels are given of them."""
