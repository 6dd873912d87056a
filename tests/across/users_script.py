"""A user's script with types: `mypy --strict` accepts it (test_types.py), and it runs in an empty folder."""

from __future__ import annotations

import pathlib

import numpy as np
from numpy.typing import NDArray

import refsim


def scene(tension: float) -> refsim.Scene:
    """A drop of 33 particles in 2D."""
    return refsim.Scene(
        name="drop",
        dim=2,
        dtype="float64",
        spacing=0.001,
        support_radius=0.0026,
        end_time=2e-4,
        step=5e-5,
        fluid=(refsim.Ball(radius=0.003), refsim.Cloud(position=np.array([[0.01, 0.01]]))),
        effects=(
            refsim.WeaklyCompressible(sound_speed=3.4, dynamic_viscosity=0.13, density="summation"),
            refsim.Gravity(acceleration=(0.0, -9.81, 0.0)),
            refsim.TartakovskyMeakin2005(surface_tension=tension),
        ),
        energy_audit=refsim.EnergyAudit(every=2),
    )


def height(frame: refsim.RunFrame) -> float:
    """Height of the centre of a frame [m]."""
    position: NDArray[np.float64] = frame.position
    return float(position[:, 1].mean())


def show(simulation: refsim.Simulation) -> None:
    """Called after every step."""
    result: refsim.StepResult | None = simulation.last
    if result is not None:
        print(simulation.time, result.limiter, simulation.field("density").max())


def main() -> None:
    """One run, its results, and an error that is caught."""
    folder = pathlib.Path("drop_run")
    plan: refsim.Plan = refsim.make_plan(scene(0.072))
    print(plan, plan.grid.count, [field.unit for field in plan.fields.values()])
    report: refsim.RunReport = refsim.simulate(plan, backend="numpy", output=folder, every=1e-4, progress=show)
    run: refsim.Run = refsim.open_run(folder)
    heights: list[float] = [height(frame) for frame in run]
    density: NDArray[np.float64] = run.at(1e-4)["density"]
    mass: float = run.ledger["mass"]["end"]
    print(report.steps, heights, density.max(), mass, run.scene.name, run.fields["density"].unit)
    other: refsim.Scene = run.scene.with_(tartakovsky_meakin_2005__surface_tension=0.05)
    simulation = refsim.Simulation(other, backend="numpy")
    while simulation.steps < 2:
        step: refsim.StepResult = simulation.step()
        print(step.length, step.limits)
    try:
        refsim.load_scene("none.toml")
    except refsim.InputError as error:
        print(error)
    except refsim.RunStopped as stop:
        print(stop.reason, stop.report)


if __name__ == "__main__":
    main()
