"""The wavefront: from a scene to a picture."""
