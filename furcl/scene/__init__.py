"""Scene files: their tables, reading them, camera and colour of a scene."""
