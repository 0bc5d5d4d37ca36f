"""Lamps: lights that a scene has any number of, and how one of them is chosen."""
