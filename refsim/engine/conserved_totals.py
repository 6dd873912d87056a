"""What the particles of a run are in sum: their number, mass, momenta and energies, and that none is lost."""

import math
from typing import Any

import numpy as np

from refsim.core.capabilities import KeepsLedger
from refsim.core.errors import RunStopped
from refsim.engine.simulation import Simulation
from refsim.scene.plan import Plan
from refsim.sph import acceleration_of, gravity_of
from refsim.sph.operations import at_planes


def conserved_totals(simulation: Simulation | Plan) -> dict[str, Any]:
    """The particles' number, mass [kg], momenta and energies, now (a simulation) or at the start (a plan).

    Sums in float64, in 2D per metre of depth. `outside_walls` counts those behind a wall; `effects` is what the effects
    keep account of, by their names.
    """
    if isinstance(simulation, Plan):
        plan, state = simulation, simulation.state
        place = plan.grid.local(state.position).astype(plan.grid.dtype)  # as a run holds it
        values = {"position": plan.grid.absolute(place), "velocity": state.velocity, "mass": state.mass, **state.values}
        lattice = np.full(plan.grid.count, plan.grid.spacing**plan.grid.dim)  # volume of its particles
        values = {"volume": lattice, **values}
        kinds = {name: f.numpy_dtype(plan.grid.dtype) for name, f in plan.fields.items()} | {"position": float}

        def field(name: str) -> np.ndarray:
            return values[name].astype(kinds[name])
    else:
        plan, field = simulation.plan, simulation.field
    x, v, m = (field(name).astype(float) for name in ("position", "velocity", "mass"))
    bounds, local = plan.shared.get("bounds"), plan.grid.local(x).astype(plan.grid.dtype)
    outside = 0 if bounds is None else int(at_planes(bounds, local, local, v, None)[3].sum())
    momenta = {"momentum": m[:, None] * v, "angular_momentum": m[:, None] * np.cross(x, v)}
    result: dict[str, Any] = {"particles": len(x), "mass": math.fsum(m)}
    result |= {name: each.sum(0).tolist() for name, each in momenta.items()}
    result["kinetic_energy"] = float(0.5 * (m * (v**2).sum(1)).sum())
    result["greatest_speed"] = float(np.sqrt((v**2).sum(1).max(initial=0.0)))
    result["outside_walls"] = outside
    if gravity_of(plan.effects) is not None:
        result["potential_energy"] = float(-(m * (x @ np.array(acceleration_of(plan.effects)))).sum())
    keeping = ((name, effect) for name, effect in plan.effects.items() if isinstance(effect, KeepsLedger))
    accounts = {name: effect.ledger(field) for name, effect in keeping}
    if any(accounts.values()):
        result["effects"] = {name: account for name, account in accounts.items() if account}
    return result


def check_particles(simulation: Simulation) -> None:
    """Raise RunStopped("particles_lost") where not every particle of the start is there with its own mass."""
    n, start = simulation.count, simulation.plan.state
    identity = np.array(simulation.backend.host(simulation.fields["identity"]))
    lost = n - len(np.unique(identity[(identity >= 0) & (identity < n)]))
    changed = 0
    if not lost and not any("mass" in p.updates for _, p in simulation.plan.all_passes()):
        changed = int((simulation.field("mass") != start.mass.astype(simulation.plan.grid.dtype)).sum())
    if lost or changed:
        raise RunStopped(
            "particles_lost",
            f"At step {simulation.steps} and {simulation.time:.6g} s {lost} of {n} particles are missing and"
            f" {changed} have another mass than at the start; this is an error in an effect.",
        )
