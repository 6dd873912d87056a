"""The process of another program: `python -m validation.peers MODULE`."""

import sys

from validation.peers import answer

answer(sys.argv[1])
