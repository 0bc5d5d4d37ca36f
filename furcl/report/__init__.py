"""Plots and pages of benchmark results; needs the extra `report` (matplotlib, jinja2)."""
