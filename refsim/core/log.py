"""The logger of the package."""

import functools
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import logging


@functools.cache
def log() -> "logging.Logger":
    """The logger `refsim`; it prints nothing unless the program sets up logging."""
    import logging  # here, because it takes a thirtieth of the time that importing refsim does

    logger = logging.getLogger("refsim")
    logger.addHandler(logging.NullHandler())
    return logger
