"""Strands: curves, groom files and procedural growth."""
