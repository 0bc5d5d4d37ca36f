"""Ways to break furcl by topic: each file but `case` and `harness` has a list CASES."""
