"""What each effect of a scene counts in an audit of the energy."""

from collections.abc import Mapping

from refsim.core.effect import Discretisation, Effect
from refsim.core.energy import EnergyAccount
from refsim.core.errors import InputError

MOVES = {"acceleration", "velocity", "position", "mass", "density", "rest_density", "pressure"}


def accounts(grid: Discretisation, effects: Mapping[str, Effect]) -> dict[str, EnergyAccount]:
    """The account of each effect. Raises InputError if an effect has forces without a known energy."""
    found = {}
    for name, effect in effects.items():
        account = effect.energy(grid, effects)
        passes = effect.passes(effects)
        if account is None and any(MOVES & {*p.writes, *p.updates} for p in passes):
            raise InputError(
                f"energy_audit: the forces of effect {name!r} have no energy that can be computed; leave out"
                " the audit or the effect."
            )
        found[name] = account or EnergyAccount()
    return found
