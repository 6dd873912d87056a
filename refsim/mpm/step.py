"""One step of the material point method as passes, in the order of the algorithm.

Particles to grid, forces on the grid, update of the grid, grid to particles. The points embedded at a surface
("carriers") take part in both transfers, and the surface's tension is a force on the grid.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from refsim.core.effect import Pass

STATE = ("position", "velocity", "mass", "affine", "volume_ratio")  # of a particle, as transfers read it
CLUSTER = ("cluster_share", "inverse_spread")  # of a particle with embedded points
SURFACE_PARTS = ("position", "area", "normal")  # of the samples that the tension's force takes


@dataclass(frozen=True)
class Step:
    """What the step of a scene consists of.

    reading       of the embedded points ("none", "cluster", ...); None without a surface
    tension       the surface's tension acts on the grid
    contact       and so does the walls' pull at the edge of the wetted area
    recounts      J follows the density that the grid counts
    viscous       there is viscosity
    deforms       the deformation gradient F is followed, not J alone
    accelerated   other effects accelerate the particles
    listed        there is a neighbour list, whose skin the displacements are measured against
    """

    reading: str | None
    tension: bool
    contact: bool
    recounts: bool
    viscous: bool
    deforms: bool
    accelerated: bool
    listed: bool

    def passes(self) -> Iterator[Pass]:
        """The passes of a step, in order."""
        if self.recounts:
            yield self.recount()  # with the crowding of the step before, ahead of all transfers
        if self.embedded:
            yield self.embed()
        yield self.find_cells()

        if self.viscous:
            yield self.add_viscous_stress()
        yield self.particles_to_grid()
        if self.embedded:
            yield self.carriers_to_grid()
        if self.surface:
            yield self.count_crowding()

        if self.tension:
            yield self.surface_force()
        if self.contact:
            yield self.contact_force()

        yield self.update_grid()

        if self.embedded:
            yield self.grid_to_carriers()
        yield self.grid_to_particles()

    @property
    def surface(self) -> bool:
        """Whether a surface is reconstructed."""
        return self.reading is not None

    @property
    def embedded(self) -> bool:
        """Whether its samples are embedded as points around particles."""
        return self.reading not in (None, "none")

    # Places: in which cell everything is

    def recount(self) -> Pass:
        """J relaxes towards the density that the grid counted in the step before."""
        return self._pass("mpm.recount", ("crowding",), updates=("volume_ratio", *self._deformation), begin=True)

    def embed(self) -> Pass:
        """Each sample of the surface and its mirror image become points of the cluster of their particle."""
        return self._pass("mpm.embed", ("position", "samples"), ("carriers", *CLUSTER))

    def find_cells(self) -> Pass:
        """Blocks and cells of particles, embedded points and samples."""
        return self._pass("mpm.cells", ("position", *self._samples, *self._cluster), ("cell",))

    # Particles to grid

    def add_viscous_stress(self) -> Pass:
        """The viscous stress acts through the affine field that the particles bring to the grid."""
        names = {"inverse_spread": "inverse_spread" if self.reading == "cluster" else None}
        reads = ("cell", "volume_ratio", *self._cluster)
        return Pass("mpm.viscosity", reads, updates=("affine",), names=names, stage="motion")

    def particles_to_grid(self) -> Pass:
        """Mass and momentum of the nodes, with the impulse of the pressure."""
        return self._pass("mpm.particle_to_grid", ("cell", *self._state), ("node_momentum",))

    def carriers_to_grid(self) -> Pass:
        """The same of the embedded points, added."""
        return self._pass("mpm.carriers_to_grid", ("cell", *self._state), updates=("node_momentum",))

    def count_crowding(self) -> Pass:
        """The density that the grid counts at the particles, over the density that follows from J."""
        reads = ("position", "volume_ratio", "cell", "node_momentum")
        return self._pass("mpm.count", reads, ("greatest_crowding", "crowding"))

    # Forces on the grid

    def surface_force(self) -> Pass:
        """Tension of the surface on the nodes, (4.18)."""
        return self._force("surface_energy.surface_force", writes=("node_pull",))

    def contact_force(self) -> Pass:
        """Pull of the walls at the edge of the wetted area, added."""
        return self._force("mpm.contact", updates=("node_pull",), line="surface.sample_line")

    # The grid

    def update_grid(self) -> Pass:
        """Nodal velocities after forces, gravity and walls."""
        pull = ("node_pull",) if self.tension else ()
        return self._pass("mpm.grid_update", ("node_momentum", *pull), ("node_velocity",))

    # Grid to particles

    def grid_to_carriers(self) -> Pass:
        """Moments of the nodal velocities at the embedded points."""
        return self._pass("mpm.grid_to_carriers", ("cell", "node_velocity"), ("carrier_moment",))

    def grid_to_particles(self) -> Pass:
        """Velocity, affine field, J or F, and the new position of each particle."""
        carried = ("carrier_moment",) if self.embedded else ()
        moved = ("velocity", "affine", "volume_ratio", "step_extremes", "position", *self._deformation)
        return self._pass("mpm.grid_to_particle", ("cell", "node_velocity", *self._cluster, *carried), updates=moved)

    # Inside

    @property
    def _cluster(self) -> tuple[str, ...]:
        return CLUSTER if self.embedded else ()

    @property
    def _samples(self) -> tuple[str, ...]:
        return ("samples",) if self.surface else ()

    @property
    def _deformation(self) -> tuple[str, ...]:
        return ("deformation",) if self.deforms else ()

    @property
    def _state(self) -> tuple[str, ...]:
        return (*STATE, *self._cluster, *(("acceleration",) if self.accelerated else ()))

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

    def _pass(
        self, operation: str, reads: tuple[str, ...], writes: tuple[str, ...] = (), updates: tuple[str, ...] = (),
        begin: bool = False,
    ) -> Pass:  # fmt: skip
        names = self._names()
        return Pass(operation, reads, writes, updates, names=names, stage="begin" if begin else "motion")

    def _force(
        self, operation: str, writes: tuple[str, ...] = (), updates: tuple[str, ...] = (), line: str | None = None
    ) -> Pass:
        """A force of the surface's samples on the nodes; `line` names those at the edge of a wetted area."""
        names: dict[str, str | None] = {f"sample_{part}": f"surface.sample_{part}" for part in SURFACE_PARTS}
        names |= {"surface_term": "surface.term", "spline_cells": "grid.sample_cells", "blocks": "grid.blocks"}
        names |= {"node_force": "grid.node_pull"} | ({} if line is None else {"sample_line": line})
        return Pass(operation, ("cell", "samples"), writes, updates, names=names, stage="motion")
