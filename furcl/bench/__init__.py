"""Benchmark runs behind `furcl bench`."""
