"""What models of a cylinder without a medulla share."""
