"""One step of the material point method as passes, in the order of the algorithm.

Particles to grid, forces on the grid, update of the grid, grid to particles. The points embedded at a surface
("carriers") take part in both transfers, and the surface's tension is a force on the grid.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from refsim.core.effect import Pass

STATE = ("position", "velocity", "mass", "affine", "volume_ratio")  # of a particle, as transfers read it
CLUSTER = ("cluster_share", "inverse_spread")  # of a particle with embedded points
Names = tuple[str, ...]
SURFACE_PARTS = ("position", "area", "normal")  # of the samples that the tension's force takes


@dataclass(frozen=True)
class Step:
    """What the step of a scene consists of."""

    reading: str | None  # of the embedded points ("none", "cluster", ...); None without a surface
    tension: bool  # the surface's tension acts on the grid
    viscous: bool  # there is viscosity
    deforms: bool  # the deformation gradient F is followed, not J alone
    accelerated: bool  # other effects accelerate the particles
    listed: bool  # there is a neighbour list, whose skin the displacements are measured against

    def passes(self) -> Iterator[Pass]:
        """The passes of a step, in order."""
        deformation = ("deformation",) if self.deforms else ()
        cluster = CLUSTER if self.embedded else ()
        state = ("cell", *STATE, *cluster, *(("acceleration",) if self.accelerated else ()))
        pull = ("node_pull",) if self.tension else ()

        # Places: in which cell everything is
        if self.embedded:
            yield self._pass("mpm.embed", ("position", "samples"), ("carriers", *CLUSTER))
        yield self._pass("mpm.cells", ("position", *(("samples",) if self.surface else ()), *cluster), ("cell",))

        # Particles to grid: mass and momentum of the nodes, with the impulse of pressure and viscous stress
        if self.viscous:
            names: dict[str, str | None] = {"inverse_spread": "inverse_spread" if self.reading == "cluster" else None}
            reads = ("cell", "volume_ratio", *cluster)
            yield Pass("mpm.viscosity", reads, updates=("affine",), names=names, stage="motion")
        yield self._pass("mpm.particle_to_grid", state, ("node_momentum",))
        if self.embedded:
            yield self._pass("mpm.carriers_to_grid", state, updates=("node_momentum",))
        if self.surface:
            reads = ("position", "volume_ratio", "cell", "node_momentum")
            yield self._pass("mpm.count", reads, ("greatest_crowding", "crowding"))

        # Force on the grid: tension of the surface, (4.18)
        if self.tension:
            held: dict[str, str | None] = {f"sample_{part}": f"surface.sample_{part}" for part in SURFACE_PARTS}
            held |= {"surface_term": "surface.term", "spline_cells": "grid.sample_cells", "blocks": "grid.blocks"}
            held |= {"node_force": "grid.node_pull"}
            reads = ("cell", "samples")
            yield Pass("surface_energy.surface_force", reads, writes=pull, names=held, stage="motion")
        yield self._pass("mpm.grid_update", ("node_momentum", *pull), ("node_velocity",))

        # Grid to particles: velocity, affine field, J or F, and the new position
        if self.embedded:
            yield self._pass("mpm.grid_to_carriers", ("cell", "node_velocity"), ("carrier_moment",))
        reads = ("cell", "node_velocity", *cluster, *(("carrier_moment",) if self.embedded else ()))
        moved = ("velocity", "affine", "volume_ratio", "step_extremes", "position", *deformation)
        yield self._pass("mpm.grid_to_particle", reads, updates=moved)

    @property
    def surface(self) -> bool:
        """Whether a surface is reconstructed."""
        return self.reading is not None

    @property
    def embedded(self) -> bool:
        """Whether its samples are embedded as points around particles."""
        return self.reading not in (None, "none")

    # Inside

    def _names(self) -> Mapping[str, str | None]:
        """Names of the arguments that are no fields; None for those that this step does not have."""
        names: dict[str, str | None] = {n: f"grid.{n}" for n in ("node_mass", "node_momentum", "node_velocity")}
        names["node_pull"] = "grid.node_pull" if self.tension else None
        names["surface_sample"] = "surface.sample_position" if self.surface else None
        names["sample_owner"] = "surface.sample_nearest" if self.surface else None
        for part in ("first", "position", "owner", "moment"):
            names[f"carrier_{part}"] = f"surface.carrier_{part}" if self.embedded else None
        lacking = {
            "acceleration": not self.accelerated, "build_position": not self.listed, "deformation": not self.deforms,
            "cluster_share": not self.embedded, "inverse_spread": not self.embedded, "embedding": not self.embedded,
        }  # fmt: skip
        return names | {name: None for name, lacks in lacking.items() if lacks}

    def _pass(self, operation: str, reads: Names, writes: Names = (), updates: Names = ()) -> Pass:
        return Pass(operation, reads, writes, updates, names=self._names(), stage="motion")
