"""`python -m furcl` is the command `furcl`."""

from furcl.cli import main

main()
