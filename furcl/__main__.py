"""`python -m furcl` is the command `furcl`."""

import sys

# With -m Python looks into the working folder first, which may be a downloaded scene's, with a file
# numpy.py in it.
if not sys.flags.safe_path:
    del sys.path[0]

from furcl.cli import main

main()
