"""Kernels that follow from a pair function: the acceleration is the sum of its terms over the neighbours.

`force` makes the kernel of one pair function, `together` that of two whose neighbours a GPU then reads once, `joined`
the pair function of two for another kernel. A kernel takes the position, the fields that the pair function reads, the
lists, and what else the pair function names; `refsim show OPERATION` prints it.
"""

import inspect
import sys
import textwrap
from collections.abc import Callable, Iterable, Mapping

from refsim.backends.compile import Kernel
from refsim.backends.tuples import added, over, scaled
from refsim.backends.written import function_of
from refsim.neighbours.pair_functions import DISTANCE, SEPARATION, parts_of, terms
from refsim.neighbours.pairs import neighbour_sum, pair
from refsim.neighbours.rows import add_vector

WIDTH = 120


def force(
    of: Callable, name: str = "", *, divided: str = "", times: str = "", walled: Callable | None = None,
    period: bool = False, given: Mapping[str, str] | None = None, around: str = "neighbours",
) -> Kernel:  # fmt: skip
    """The kernel that adds to the acceleration [m/s^2] the sum of the terms of the pair function `of`.

    name     of the kernel; that of the pair function without "_pair" by default
    divided  field of the particle by which the sum is divided
    times    member of a group, "attraction.strength", by which it is multiplied
    walled   formula of the walls' part, of (i, lane, position, density, pressure, walls, smoothing, fluid, period)
    period   whether separations are to the nearest image in a periodic box
    given    expressions for what the pair function takes and the kernel does not
    around   "neighbours", or "walls", wall particles with `place` and `volume`, by one thread for each particle
    """
    called, box, lanes = _called(of), "period" if period else "None", around == "neighbours"
    given = (given or {}) if lanes else {"place": "walls.position", "volume": "walls.volume"}
    lane = "lane" if lanes else "None"
    parts = [part for part in parts_of(of) if part[0] not in (DISTANCE, SEPARATION)]
    summed = dict.fromkeys(part for part, _ in parts)
    groups = [part for part, index in parts if not index and part not in given]
    taken = [part for part, index in parts if index and part not in given] + [divided] * bool(divided)
    taken += [around, *["walls"] * bool(walled), *groups, *[times.partition(".")[0]] * bool(times)]
    taken += [*["fluid"] * bool(walled), *["period"] * period, "acceleration"]
    lines = [
        *_call(f"def {name or of.__name__.removesuffix('_pair')}(", ["i", *["lane"] * lanes, "position", *taken], "):"),
        f'    """Sum of `{called}` over the {around}; added to the acceleration [m/s^2]."""',
        *_call(
            "    a = neighbour_sum(",
            [called, "i", lane, around, "position", box, *(given.get(part, part) for part in summed)], ")",
        ),
    ]  # fmt: skip
    if times:
        lines.append(f"    a = scaled(a, {times}{f' / {divided}[i]' if divided else ''})")
    elif divided:
        lines.append(f"    a = over(a, {divided}[i])")
    if walled:
        smoothing = next(group for group in ("gradient_smoothing", "smoothing") if group in groups)
        walls = f"i, lane, position, density, pressure, walls, {smoothing}, fluid, {box}"
        lines += ["    if walls is not None:", f"        a = added(a, {_called(walled, of)}({walls}))"]
    lines.append(f"    add_vector(acceleration, i, {lane}, a)")
    return Kernel(_made(of, lines, *([walled] if walled else [])), lanes=lanes)


def together(
    name: str, first: Callable, second: Callable, walled: Callable | None = None,
    names: Mapping[str, str] | None = None, per_volume: bool = False,
) -> tuple[Callable, Kernel]:  # fmt: skip
    """(pair function, kernel) of `first`, a force per volume, and `second`, one per mass, or with `per_volume` as well.

    name   of the kernel; the pair function's ends in "_pair"
    names  what the sum calls parameters of `second`, or values of them; `first` takes `gradient_smoothing`
    """
    share, unit = ("", "N/m^3") if per_volume else (" * inverse_density", "m/s^2")
    given = {} if per_volume else {"inverse_density": "type(density[i])(1) / density[i]"}
    parts = (first, {"smoothing": "gradient_smoothing", "volume_j": "mass_j"}), (second, names or {})
    force_of_both = ", ".join(f"t0[{c}]{share} + t1[{c}]" for c in range(3))
    both = pair(_made(second, _in_turn(f"{name}_pair", f" [{unit}]", force_of_both, *parts, given=given), first))
    divided = "density" if per_volume else ""
    return both, force(both, divided=divided, walled=walled, given=given)


def joined(name: str, *parts: tuple[Callable, Mapping[str, str]]) -> Callable:
    """The pair function with the terms of two, given with what the sum calls some of their parameters."""
    each = ", ".join(f"t{k}[{c}]" for k, (part, _) in enumerate(parts) for c in range(terms(part)))
    return pair(_made(parts[1][0], _in_turn(name, "", each, *parts), parts[0][0]))


def _in_turn(
    name: str, unit: str, returned: str, *parts: tuple[Callable, Mapping[str, str]], given: Iterable[str] = ()
) -> list[str]:
    """Lines of a pair function that returns what follows from the terms t0, t1 of others."""
    takes = [[called.get(name, name) for name in inspect.signature(part).parameters] for part, called in parts]
    taken = [name for names in (*takes, given) for name in names if name.isidentifier() and name != "None"]
    called = [_called(part, parts[-1][0]) for part, _ in parts]
    return [
        *_call(f"def {name}(", taken, "):"),
        f'    """Terms of {" and ".join(f"`{part}`" for part in called)}{unit}."""',
        *(line for k, part in enumerate(called) for line in _call(f"    t{k} = {part}(", takes[k], ")")),
        f"    return {returned}",
    ]


def _called(function: Callable, beside: Callable | None = None) -> str:
    """Name of a function in its own module or in that of the function `beside` it."""
    space = vars(sys.modules[(beside or function).__module__])
    return next((name for name, value in space.items() if value is function), function.__name__)


def _call(begin: str, arguments: Iterable[str], end: str) -> list[str]:
    """Lines of a call or of a head, each argument once."""
    names = ", ".join(dict.fromkeys(arguments) if begin.startswith("def") else arguments)
    if len(begin + names + end) <= WIDTH:
        return [begin + names + end]
    space = " " * (len(begin) - len(begin.lstrip()))
    return [begin, *textwrap.wrap(f"{names},", WIDTH, initial_indent=f"{space}    ", subsequent_indent=f"{space}    "),
            space + end]  # fmt: skip


def _made(of: Callable, lines: list[str], *more: Callable) -> Callable:
    """The function of these lines, as if it stood in the module of `of`; it calls `of` and the functions `more`."""
    name, text = lines[0].removeprefix("def ").partition("(")[0], "\n".join(lines) + "\n"
    path = f"<{of.__module__}.{name}>"
    space = {"neighbour_sum": neighbour_sum, "added": added, "over": over, "scaled": scaled, "add_vector": add_vector}
    space |= {_called(function, of): function for function in (of, *more)} | {"__name__": of.__module__}
    return function_of(text, name, path, space)
