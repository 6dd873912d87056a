"""Right densities in five languages, four ways to sum in each: forwards, backwards, in blocks, with compensation.

`python -m tests.contract.right [SEEDS]` holds each to the drawn inputs of so many seeds. Compilers are found on the
path: gcc (or cc), gfortran, rustc, zig; what is not there is said.
"""

import ctypes
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np

from refsim.contract import Programs, trials

WAYS = ("forwards", "backwards", "in blocks", "compensated")
C = """
#include <math.h>
#include <stdint.h>
void density(int64_t n, int64_t way, const double *x, const double *m, double h, double scale, double *rho) {
  for (int64_t i = 0; i < n; i++) {
    double sum = 0, lost = 0, part[4] = {0, 0, 0, 0};
    for (int64_t k = 0; k < n; k++) {
      int64_t j = way == 1 ? n - 1 - k : k;
      double a = x[3*i] - x[3*j], b = x[3*i+1] - x[3*j+1], c = x[3*i+2] - x[3*j+2];
      double q = sqrt(a*a + b*b + c*c) / h;
      if (q >= 1) continue;
      double w = m[j] * (1-q)*(1-q)*(1-q)*(1-q) * (1 + 4*q);
      if (way == 2) part[k % 4] += w;
      else if (way == 3) { double y = w - lost, t = sum + y; lost = (t - sum) - y; sum = t; }
      else sum += w;
    }
    rho[i] = scale * (sum + ((part[0] + part[1]) + (part[2] + part[3])));
  }
}
"""
FORTRAN = """
subroutine density(n, way, x, m, h, scale, rho) bind(c)
  use iso_c_binding
  integer(c_int64_t), value :: n, way
  real(c_double), value :: h, scale
  real(c_double), intent(in) :: x(3, n), m(n)
  real(c_double), intent(out) :: rho(n)
  integer(c_int64_t) :: i, j, k
  real(c_double) :: total, lost, part(0:3), q, w, y, t
  do i = 1, n
    total = 0; lost = 0; part = 0
    do k = 1, n
      j = merge(n + 1 - k, k, way == 1)
      q = sqrt(sum((x(:, i) - x(:, j))**2)) / h
      if (q >= 1) cycle
      w = m(j) * (1 - q)**4 * (1 + 4 * q)
      if (way == 2) then
        part(mod(k, 4_c_int64_t)) = part(mod(k, 4_c_int64_t)) + w
      else if (way == 3) then
        y = w - lost; t = total + y; lost = (t - total) - y; total = t
      else
        total = total + w
      end if
    end do
    rho(i) = scale * (total + sum(part))
  end do
end subroutine
"""
RUST = """
#[no_mangle]
pub unsafe extern "C" fn density(n: i64, way: i64, x: *const f64, m: *const f64, h: f64, scale: f64, rho: *mut f64) {
    let at = |i: i64, c: i64| unsafe { *x.offset((3 * i + c) as isize) };
    for i in 0..n {
        let (mut sum, mut lost, mut part) = (0.0f64, 0.0f64, [0.0f64; 4]);
        for k in 0..n {
            let j = if way == 1 { n - 1 - k } else { k };
            let d = [at(i, 0) - at(j, 0), at(i, 1) - at(j, 1), at(i, 2) - at(j, 2)];
            let q = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt() / h;
            if q >= 1.0 { continue; }
            let w = unsafe { *m.offset(j as isize) } * (1.0 - q).powi(4) * (1.0 + 4.0 * q);
            if way == 2 { part[(k % 4) as usize] += w; }
            else if way == 3 { let y = w - lost; let t = sum + y; lost = (t - sum) - y; sum = t; }
            else { sum += w; }
        }
        unsafe { *rho.offset(i as isize) = scale * (sum + ((part[0] + part[1]) + (part[2] + part[3]))); }
    }
}
"""
ZIG = """
export fn density(n: i64, way: i64, x: [*]const f64, m: [*]const f64, h: f64, scale: f64, rho: [*]f64) void {
    const count: usize = @intCast(n);
    for (0..count) |i| {
        var sum: f64 = 0;
        var lost: f64 = 0;
        var part = [4]f64{ 0, 0, 0, 0 };
        for (0..count) |k| {
            const j = if (way == 1) count - 1 - k else k;
            const a = x[3 * i] - x[3 * j];
            const b = x[3 * i + 1] - x[3 * j + 1];
            const c = x[3 * i + 2] - x[3 * j + 2];
            const q = @sqrt(a * a + b * b + c * c) / h;
            if (q >= 1) continue;
            const e = (1 - q) * (1 - q);
            const w = m[j] * e * e * (1 + 4 * q);
            if (way == 2) {
                part[k % 4] += w;
            } else if (way == 3) {
                const y = w - lost;
                const t = sum + y;
                lost = (t - sum) - y;
                sum = t;
            } else {
                sum += w;
            }
        }
        rho[i] = scale * (sum + ((part[0] + part[1]) + (part[2] + part[3])));
    }
}
"""
COMPILED = {  # {language: (source, its name, compilers, command behind them)}
    "C": (C, "d.c", ("gcc", "cc"), "-O2 -shared -fPIC d.c -o d_C.so -lm"),
    "Fortran": (FORTRAN, "d.f90", ("gfortran",), "-O2 -shared -fPIC d.f90 -o d_Fortran.so"),
    "Rust": (RUST, "d.rs", ("rustc",), "-O --crate-type cdylib d.rs -o d_Rust.so"),
    "Zig": (ZIG, "d.zig", ("zig",), "build-lib -dynamic -O ReleaseFast -lc d.zig -femit-bin=d_Zig.so"),
}


def library(language, folder):
    """The compiled library; None without a compiler."""
    source, name, compilers, command = COMPILED[language]
    found = next((place for place in map(shutil.which, compilers) if place), None)
    if found is None:
        return None
    (folder / name).write_text(source)
    subprocess.run([found, *command.split()], check=True, cwd=folder, capture_output=True)
    return ctypes.CDLL(str(folder / command.split("-o ")[-1].split("=")[-1].split()[0]))


def in_numpy(way, x, m, h, scale):
    q = np.sqrt(((x[:, None] - x[None]) ** 2).sum(2)) / h
    terms = m * np.where(q < 1, (1 - q) ** 4 * (1 + 4 * q), 0)
    if way == 1:
        return scale * np.cumsum(terms[:, ::-1], 1)[:, -1] if len(m) else m
    if way == 2:
        return scale * sum(terms[:, k::4].sum(1) for k in range(4))
    return scale * (np.einsum("ij->i", terms) if way == 3 else terms.sum(1))


def programs(way, compiled=None):
    """A library of one function; NumPy's without `compiled`."""

    def density(position, mass, smoothing, density):
        x, m = (np.ascontiguousarray(v, float) for v in (position, mass))
        h, scale = float(smoothing.support_radius), float(smoothing.value_scale)
        if compiled is None:
            density[:] = in_numpy(way, x, m, h, scale)
            return
        result, real = np.zeros(len(m)), ctypes.c_double
        pointers = [ctypes.c_void_p(v.ctypes.data) for v in (x, m)]
        whole = (ctypes.c_int64(len(m)), ctypes.c_int64(way))
        compiled.density(*whole, *pointers, real(h), real(scale), ctypes.c_void_p(result.ctypes.data))
        density[:] = result

    return Programs(
        {"sph.density": density}, kernels=("wendland_c2",), walls=False, most_particles=3000, name="right",
        without=("number_density", "asymmetry", "period"),
    )  # fmt: skip


def alarms(way, compiled, seeds, steps=("T11",)):
    """(alarms, trials) over the seeds."""
    found = [
        o for seed in seeds for o in trials(programs(way, compiled), "sph.density", (), (0,), steps, seed=seed)
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
            for way, name in enumerate(WAYS):
                found, tried = alarms(way, compiled, seeds)
                print(f"{language:8} {name:12} {len(found)} alarms in {tried} trials", *found[:1], flush=True)
