"""T8: a run that was stopped and resumed is the run that was not, bit for bit, and is not changed by being watched."""

import pathlib
import tempfile
from collections.abc import Callable, Iterator

from refsim.contract.target import Outcome
from refsim.engine.simulation import Simulation
from refsim.scene.scene import Scene


def bits(simulation: Simulation) -> dict[str, bytes]:
    """Everything that a run carries from step to step, in the particles' first order."""
    fields = {name: simulation.field(name).tobytes() for name, f in simulation.plan.fields.items() if f.state}
    return fields | {"time": repr((simulation.time, simulation.steps, simulation.previous_length)).encode()}


def resumes(scene: Scene, backend: str = "cpu", steps: tuple[int, int] = (7, 9)) -> Iterator[Outcome]:
    """T8 for one scene on one backend: `steps` before and after the checkpoint.

    Compared are a run that never stopped, the run that wrote the checkpoint, and one resumed from it, at the
    checkpoint and at the end. Raises InputError for a bad scene or a backend that is not there.
    """
    begin, rest = steps

    def advanced(simulation: Simulation, count: int) -> Simulation:
        for _ in range(count):
            simulation.step()
        return simulation

    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / "checkpoint.h5"
        whole = bits(advanced(Simulation(scene, backend), begin + rest))
        watched = advanced(Simulation(scene, backend), begin)
        half = bits(watched)
        watched.checkpoint(path)
        resumed = Simulation.resume(path)

        def outcome(trial: str, same: Callable[[], bool]) -> Outcome:
            passed = bool(same())
            name = f"{scene.name}: {trial}"
            return Outcome("run", "T8", name, backend, scene.dtype, 0, passed, 0.0 if passed else float("inf"))

        yield outcome("resumed as it was", lambda: bits(resumed) == half)
        yield outcome("resumed to the end", lambda: bits(advanced(resumed, rest)) == whole)
        yield outcome("writing changed nothing", lambda: bits(advanced(watched, rest)) == whole)
        yield outcome("something happened", lambda: half["position"] != whole["position"])
