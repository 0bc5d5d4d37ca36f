"""Light from outside the scene."""
