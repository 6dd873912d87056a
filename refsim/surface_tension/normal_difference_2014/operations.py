"""Operations of the tension by normal differences."""

from refsim.core.operation import SYMMETRY, operation
from refsim.neighbours.sums import Fields, neighbours
from refsim.surface_tension.normal_difference_2014 import reference as ref


@operation(
    "patent P7 with symmetric masses", paper="patent CN104318598A, 2014", adds="acceleration",
    variants=("", {"normal_tension": "as_printed"}), tolerance=8.0,
    reason="one rounding in each of the difference, the mean mass, product and sum; not in the bound: the force does"
    " not vanish at r = h, so that a pair which a rounding moves across r = h changes a by 2 gamma m_j/(m_i + m_j)"
    " |n_i - n_j|, |n_i - n_j| at most 3.2 s (as akinci_2013.tension)", invariants=f"{SYMMETRY} linear_momentum",
    broken={1: "linear_momentum"},
    packed="difference_pair",
)  # fmt: skip
def tension(position, mass, surface_normal, smoothing, normal_tension, rows=None):
    """Acceleration [m/s^2] by normal differences."""
    i = Fields(position=position, mass=mass, normal=surface_normal)
    of = {"gamma": normal_tension.coefficient, "printed": bool(normal_tension.printed_mass)}
    return {"acceleration": neighbours(i, i, smoothing, rows=rows).others(ref.tension, **of)}
