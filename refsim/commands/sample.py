"""`refsim sample`: a mesh becomes boundary particles."""

import argparse
import time

import numpy as np

from refsim.boundary.mesh import load_mesh
from refsim.boundary.sampling import LITERAL, MOST_ITERATIONS, sample
from refsim.commands import CommandResult, command, in_bytes, in_time, table, takes
from refsim.core.errors import InputError
from refsim.core.writing import output_path
from refsim.io.vtp import write_vtp

DESCRIPTION = (
    "Spread particles evenly over a closed triangle mesh: signed distance in a narrow band, g A/(pi r^2) particles,"
    " relaxation (patent CN104318598A)."
)


@command("sample", "spread boundary particles over a mesh", DESCRIPTION)
@takes("mesh", help="mesh file: .obj, .stl, .ply, .off, .glb and whatever else trimesh reads")
@takes("--radius", type=float, required=True, help="r of the particles [m]; they stand about 2 r apart")
@takes("-o", "--output", default="boundary.vtp", help="VTP file to write (default boundary.vtp)")
@takes("--seed", type=int, default=0, help="of the first places (default 0)")
@takes("--grid-spacing", type=float,
       help="of the signed distance's grid [m] (default 1.5 r, less for thin or sharp parts)")  # fmt: skip
@takes("--density", type=float, help="g in g A/(pi r^2) (default pi/(2 sqrt 3) = 0.9069, hexagonal)")
@takes("--iterations", type=int, default=MOST_ITERATIONS, help="most iterations of the relaxation")
@takes("--literal", default="", help=f"readings of the patent: {', '.join(LITERAL)}, paper or all")
@takes("--backend", default="cpu", choices=("cpu", "cuda"), help="where it runs (default cpu)")
def execute(options: argparse.Namespace) -> CommandResult:
    """Read, sample, write, and say how even the particles are."""
    output = output_path(options.output, "file of particles", ".vtp")
    if options.iterations < 1:
        raise InputError(f"sample: --iterations {options.iterations} is not possible; give 1 or more.")
    began = time.perf_counter()
    mesh = load_mesh(options.mesh)
    extra = {} if options.density is None else {"density": options.density}
    sampled = sample(
        mesh, options.radius, seed=options.seed, spacing=options.grid_spacing, backend=options.backend,
        literal=tuple(filter(None, options.literal.split(","))), most_iterations=options.iterations, **extra,
    )  # fmt: skip
    nearest = nearest_distances(sampled.position)
    write_vtp(output, sampled.position, normal=sampled.normal, nearest=nearest)
    seconds = time.perf_counter() - began
    mean = float(nearest.mean()) if len(nearest) > 1 else 0.0
    data = {
        "mesh": options.mesh, "triangles": len(mesh.faces), "area": mesh.area, "volume": mesh.volume,
        "extent": mesh.extent.tolist(), "particles": len(sampled.position), "expected": sampled.expected,
        "radius": options.radius, "mean_spacing": mean,
        "least_over_mean_spacing": float(nearest.min() / mean) if mean else 0.0,
        "spacing_variation": float(nearest.std() / mean) if mean else 0.0,
        "iterations": sampled.iterations, "converged": sampled.converged, "residual": sampled.residual,
        "grid_spacing": sampled.field.spacing, "grid_bytes": sampled.field.nbytes, "seconds": seconds,
        "output": str(output),
        "repairs": list(mesh.notes), "notes": list(sampled.notes),
    }  # fmt: skip
    rows = [
        ("mesh", f"{len(mesh.faces):,} triangles, {' x '.join(f'{x:.4g}' for x in mesh.extent)} m, area"
                 f" {mesh.area:.4g} m^2, volume {mesh.volume:.4g} m^3"),
        ("particles", f"{len(sampled.position):,}; g A/(pi r^2) = {sampled.expected:,.1f}"),
        ("spacing", f"{mean:.4g} m on average, least {data['least_over_mean_spacing']:.3f} of it, variation"
                    f" {data['spacing_variation']:.3f}"),
        ("relaxation", f"{sampled.iterations} iterations, {'' if sampled.converged else 'not '}converged: the last one"
                       f" moved them by {sampled.residual:.2g} r"),
        ("distance grid", f"{sampled.field.spacing:.4g} m, {in_bytes(sampled.field.nbytes)}"),
        ("written", f"{output} with fields normal and nearest, {in_time(seconds)}"),
    ]  # fmt: skip
    rows += [("repaired", note) for note in mesh.notes] + [("note", note) for note in sampled.notes]
    return CommandResult(data, table(rows))


def nearest_distances(position: np.ndarray) -> np.ndarray:
    """(n,) distance [m] of each particle from the nearest other one, infinite for one alone."""
    from scipy.spatial import cKDTree

    distance, _ = cKDTree(position).query(position, k=2)
    return np.asarray(distance)[:, 1]
