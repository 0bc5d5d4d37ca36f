"""Benchmark runs behind `furcl bench`; each module is importable."""
