"""What each part of the fast road on a CPU buys (docs/guarantees.md): `python tests/times/parts.py [SCENE...]`.

Prints the processor time of a step without a part over that with all (one thread, float32, tenth percentile), then
seconds of compiling four sums, milliseconds of a list of 13,824 particles, and the share of 3,000 densities that have
other bits if their kernel has two outputs more. Each is measured in a process of its own that does without the part.
"""

import argparse
import os
import pathlib
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]
SCENES = ["dam_break_2d", "droplet", "mesh_boundary", "melting", "mpm_droplet"]
SUMS = "sph.density", "sph.momentum", "sph.continuity", "surface_normal.color_gradient"
PARTS = ["", "staging", "rows", "vectors", "shape", "plain"]
SECONDS, LEAST, ROUNDS = 4.0, 24, 3  # of steps that are timed, the fastest of some rounds


def take_out(part):
    """Do without a part in this process, whatever is imported afterwards."""
    import numba
    from llvmlite import binding

    from refsim.backends.fast import bits, rows

    if part == "vectors":
        binding.set_option = lambda *option: None
    elif part == "rows":
        rows.over_rows = numba.njit(rows.over_rows)
    elif part == "bits":
        bits.marked, bits.lowest = numba.njit(bits.marked), numba.njit(bits.lowest)
    elif part == "staging":
        from refsim.neighbours import pairs

        source = pairs.loop_source
        pairs.loop_source = lambda pair, listed, *more: source(pair, listed, *more[:2], "start" in listed)
    elif part == "shape":
        from refsim.smoothing import Smoothing

        Smoothing.fixed = lambda smoothing: smoothing


def step(name):
    """Milliseconds of a step of an example."""
    from refsim import Simulation, load_scene

    simulation = Simulation(load_scene(ROOT / "refsim" / "examples" / f"{name}.toml"), "cpu", 1)
    for _ in range(20):
        simulation.step()
    taken, end = [], time.process_time() + SECONDS
    while len(taken) < LEAST or time.process_time() < end:
        begun = time.process_time()
        simulation.step()
        taken.append(time.process_time() - begun)
    return 1e3 * sorted(taken)[len(taken) // 10]


def compiling(threads):
    """Seconds in which four sums are compiled."""
    import numba

    from refsim.contract import Target
    from refsim.contract.answers import on_case
    from refsim.core import cases
    from refsim.core.operation import REGISTRY

    cases.discover()
    numba.set_num_threads(int(threads))
    seconds = 0.0
    for again, name in [(again, name) for again in (False, True) for name in SUMS]:
        begun = time.process_time()
        assert on_case(Target(REGISTRY[name], "cpu", "float32", 0), "cloud_3d").passed
        seconds += (time.process_time() - begun) * (-1 if again else 1)
    return seconds


def listing(edge):
    """Milliseconds in which the list of a cube is built."""
    from refsim import Box, Scene, Simulation, WeaklyCompressible

    cube = (Box(cells=(int(edge),) * 3),)
    effects = (WeaklyCompressible(sound_speed=10.0),)
    simulation = Simulation(Scene(spacing=0.1, support_radius=0.26, fluid=cube, effects=effects), "cpu", 1)
    simulation.step()
    taken = []
    for _ in range(25):
        begun = time.process_time()
        simulation.search.build(simulation.fields["position"])
        taken.append(time.process_time() - begun)
    return 1e3 * sorted(taken)[2]


def other_bits(case):
    """Share of densities with other bits if their kernel has two outputs more."""
    from refsim import contract
    from refsim.core.operation import REGISTRY, without

    densities = []
    for left_out in ("number_density asymmetry walls period", "walls period"):
        values = contract.bindings("sph.density", "cpu", "float32", case, without(left_out))
        values["smoothing"] = values["smoothing"].fixed()
        REGISTRY["sph.density"].bind("cpu", values.__getitem__)()
        densities.append(values["density"])
    return (densities[0] != densities[1]).mean()


def measured(part, what, of, cache):
    """What a process without the part prints."""
    more = {"REFSIM_PLAIN": "1"} if part == "plain" else {}
    more |= {"PYTHONPATH": os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))}
    command = [sys.executable, "-W", "ignore", __file__, "--alone", part, what, of]
    environment = os.environ | {"REFSIM_CACHE_DIR": str(pathlib.Path(cache, part or "fast"))} | more
    return float(subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", metavar="SCENE", help=f"of {', '.join(SCENES)}; none: all")
    parser.add_argument("--alone", nargs=3, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.alone:
        part, what, of = given.alone
        take_out(part)
        print({f.__name__: f for f in (step, compiling, listing, other_bits)}[what](of))
        return
    for scene in given.scenes or SCENES:
        with tempfile.TemporaryDirectory() as cache:
            rounds = [[measured(part, "step", scene, cache) for part in PARTS] for _ in range(ROUNDS)]
        ms = dict(zip(PARTS, map(min, *rounds)))
        ratios = (f"{part} {ms[part] / ms['']:.2f}" for part in PARTS[1:])
        print(f"{scene}: {ms['']:.3f} ms; without {', '.join(ratios)}", flush=True)
    if not given.scenes:
        for what, of, parts in (
            ("compiling", "1", ["", "plain"]), ("compiling", "2", ["plain"]),
            ("listing", "24", ["", "bits"]), ("other_bits", "large", ["", "vectors"]),
        ):  # fmt: skip
            with tempfile.TemporaryDirectory() as cache:
                values = (f"{part or 'fast'} {measured(part, what, of, cache):.2f}" for part in parts)
                print(what, of, *values, flush=True)


if __name__ == "__main__":
    main()
