"""The papers' experiments, what they measure, their pictures, and the checks on them: `python -m validation`.

A folder of `validation.experiments` is one experiment (`validation.experiment`).
"""

import sys

from refsim.backends.threads import check_number
from refsim.core.errors import InputError

try:
    check_number()
except InputError as error:
    print(error, file=sys.stderr)
    sys.exit(2)
