"""Numba's bookkeeping while it compiles, at less cost; the code that it makes is the same.

More than half of the tests' processor time goes into compiling, most of it into Numba's own Python. These functions
give what Numba's give, without what is looked up again and again.
"""

import contextlib
import functools
from types import NoneType

from numba.core import event, ir, targetconfig
from numba.core.types import abstract

WITHOUT_VARIABLES = {str, int, float, bool, NoneType, ir.Loc}


def install():
    """Replace Numba's functions in this process."""
    event.install_timer = no_timer
    event.start_event, event.end_event = heard(event.start_event), heard(event.end_event)
    targetconfig.TargetConfig.values = values
    ir.Inst._rec_list_vars = variables
    abstract._TypeMetaclass.__instancecheck__ = type.__instancecheck__  # no class of types is a virtual one


@contextlib.contextmanager
def no_timer(kind, callback):
    """Nothing is timed: Numba notes how long it holds its locks, of which it takes one at every call of LLVM."""
    yield event.TimingListener()


def heard(announce):
    """Announce an event only where somebody listens."""

    def announce_if_heard(kind, *arguments, **options):
        if event._registered[kind]:
            announce(kind, *arguments, **options)

    return announce_if_heard


def values(options):
    """All options of a compilation by name: those that are set, else the defaults."""
    return {**defaults(type(options)), **options._values}


@functools.cache
def defaults(kind):
    return {name: option.default for name, option in kind.options.items()}


def variables(instruction, value):
    """The variables in a value: a variable, an instruction, or a container of them."""
    found = []
    collect(found, value)
    return found


def collect(found, value):
    kind = type(value)
    if kind is ir.Var:
        found.append(value)
    elif kind is dict or isinstance(value, dict):
        for part in value.values():
            if type(part) not in WITHOUT_VARIABLES:
                collect(found, part)
    elif kind is list or kind is tuple or isinstance(value, list | tuple):
        for part in value:
            collect(found, part)
    elif isinstance(value, ir.Inst):
        found.extend(value.list_vars())
