"""How near the backend "cuda" comes to the limits of its device: docs/study.md.

`tests/times/bench_device.py` measures on a GPU; `validation.times` makes page and picture of what it gave.

The work that a kernel needs at least, for each particle with M neighbours within h and L entries in its list, float32
(4 bytes a number, an index or a count). Bytes: every field is read once from memory and written once, the list is read
once by each kernel that walks it. Operations: additions, multiplications, divisions, square roots, each once; a
multiply-add is two; comparisons and indices count nothing, and what two formulas share counts once.

kernel       bytes                                                                   operations
density      24 + 4 L   x, m, count, entries; writes rho                             8 L + 11 M
state        8          rho; writes p                                                6
forces       64 + 4 L   x, v, m, rho, p, count, entries; adds to a (read, written)   8 L + 55 M + 9
extremes     24         v, a                                                         10
motion       72         a, v, x, place at the build; writes v, x                     21
list         16 + 4 L   x; writes count and entries                                  8 L

8 L are the squared distances of all listed pairs. 11 of the density are root, q, the six of Wendland's C2 shape, its
scale, and two for m W. 55 of the forces are 4 for root, r + tiny, V_j/r, 7 for the slope, 4 for the pressure pair, 13
for viscosity, 21 for J(16), and 6 for the vector of the pressure. The list's own search tests more pairs than it keeps.
"""

from typing import NamedTuple

STEP_KERNELS = ("density", "state", "forces", "extremes", "motion")  # of every step; the list is built now and then


class Work(NamedTuple):
    """What a kernel needs at least, for all particles."""

    bytes: float
    operations: float


def least(kernel: str, particles: float, neighbours: float, entries: float) -> Work:
    """The least work of a kernel; neighbours M and entries L of a particle. See the table above."""
    read_and_written, counted = {
        "density": (24 + 4 * entries, 8 * entries + 11 * neighbours), "state": (8, 6),
        "forces": (64 + 4 * entries, 8 * entries + 55 * neighbours + 9), "extremes": (24, 10), "motion": (72, 21),
        "list": (16 + 4 * entries, 8 * entries),
    }[kernel]  # fmt: skip
    return Work(particles * read_and_written, particles * counted)
