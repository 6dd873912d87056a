"""Right densities and pressure forces in five languages, with four ways to sum in each.

`python -m tests.contract.right [SEEDS]` holds each to the drawn inputs of so many seeds. Compilers are found on the
path: gcc (or cc), gfortran, rustc, zig; what is not there is said. One function gives both: with w_j = m_j and one
component sum_j w_j (1 - q)^4 (1 + 4 q), with three components sum_j w_j (p_i + p_j) (1 - q)^3 x_ij.
"""

import ctypes
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np

from refsim.contract import Programs, trials

WAYS = ("forwards", "backwards", "in blocks", "compensated")
OPERATIONS = ("sph.density", "sph.momentum")
COMPILED = {  # {language: (compilers, words behind them)}
    "C": (("gcc", "cc"), "-O2 -shared -fPIC {}/sums.c -o {} -lm"),
    "Fortran": (("gfortran",), "-O2 -shared -fPIC {}/sums.f90 -o {}"),
    "Rust": (("rustc",), "-O --crate-type cdylib {}/sums.rs -o {}"),
    "Zig": (("zig",), "build-lib -dynamic -O ReleaseFast -lc {}/sums.zig -femit-bin={}"),
}


def library(language, folder):
    """The compiled library; None without a compiler."""
    compilers, command = COMPILED[language]
    found = next((place for place in map(shutil.which, compilers) if place), None)
    if found is None:
        return None
    places = iter((Path(__file__).parent, folder / f"{language}.so"))
    words = [word.format(next(places)) if "{}" in word else word for word in command.split()]
    subprocess.run([found, *words], check=True, cwd=folder, capture_output=True)
    return ctypes.CDLL(str(folder / f"{language}.so"))


def in_numpy(way, parts, x, w, p, h):
    d = x[:, None] - x[None]
    q = np.minimum(np.sqrt((d**2).sum(2)) / h, 1)
    terms = (w * (1 - q) ** 3)[..., None] * (
        ((1 - q) * (1 + 4 * q))[..., None] if parts == 1 else (p[:, None] + p)[..., None] * d
    )
    if way == 1:
        return np.cumsum(terms[:, ::-1], 1)[:, -1] if len(x) else terms[:, 0:0].sum(1)
    if way == 2:
        return sum(terms[:, k::4].sum(1) for k in range(4))
    return np.einsum("ijc->ic", terms) if way == 3 else terms.sum(1)


def programs(way, compiled=None):
    """A library of both; NumPy's without `compiled`."""

    def sums(parts, x, w, p, smoothing):
        x, w, p = (np.ascontiguousarray(v, float) for v in (x, w, p))
        h = float(smoothing.support_radius)
        if compiled is None:
            return in_numpy(way, parts, x, w, p, h)
        result, whole = np.zeros((len(x), parts)), map(ctypes.c_int64, (len(x), way, parts))
        *given, out = (ctypes.c_void_p(v.ctypes.data) for v in (x, w, p, result))
        compiled.sums(*whole, *given, ctypes.c_double(h), out)
        return result

    def density(position, mass, smoothing, density):
        density[:] = float(smoothing.value_scale) * sums(1, position, mass, mass, smoothing)[:, 0]

    def momentum(position, mass, density, pressure, smoothing, fluid, acceleration):
        rho = np.asarray(density, float)
        scale = 20 * float(smoothing.slope_scale) * float(smoothing.inverse_radius) * float(fluid.gradient_share)
        acceleration += scale / rho[:, None] * sums(3, position, mass / rho, pressure, smoothing)

    return Programs(
        dict(zip(OPERATIONS, (density, momentum))), kernels=("wendland_c2",), walls=False, most_particles=3000,
        name="right", without=("number_density", "asymmetry", "period", "viscosity"),
    )  # fmt: skip


def alarms(way, compiled, seeds, operation, steps=("T11",)):
    """(alarms, trials) over the seeds."""
    found = [
        o for seed in seeds for o in trials(programs(way, compiled), operation, (), (0,), steps, seed=seed)
        if not o.not_judged
    ]  # fmt: skip
    return [str(o) for o in found if not o.passed], len(found)


if __name__ == "__main__":
    import tempfile

    seeds = range(int(sys.argv[1]) if len(sys.argv) > 1 else 100)
    with tempfile.TemporaryDirectory() as folder:
        for language in ("NumPy", *COMPILED):
            compiled = None if language == "NumPy" else library(language, Path(folder))
            if language != "NumPy" and compiled is None:
                print(f"{language}: no compiler is on the path")
                continue
            for operation in OPERATIONS:
                for way, name in enumerate(WAYS):
                    found, tried = alarms(way, compiled, seeds, operation)
                    told = f"{language:8} {operation:13} {name:12} {len(found)} alarms in {tried} trials"
                    print(told, *found[:1], flush=True)
