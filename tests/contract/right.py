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
C = """
#include <math.h>
#include <stdint.h>
void sums(int64_t n, int64_t way, int64_t parts, const double *x, const double *w, const double *p, double h,
          double *out) {
  for (int64_t i = 0; i < n; i++) for (int64_t c = 0; c < parts; c++) {
    double sum = 0, lost = 0, part[4] = {0, 0, 0, 0};
    for (int64_t k = 0; k < n; k++) {
      int64_t j = way == 1 ? n - 1 - k : k;
      double d[3] = {x[3*i] - x[3*j], x[3*i+1] - x[3*j+1], x[3*i+2] - x[3*j+2]};
      double q = sqrt(d[0]*d[0] + d[1]*d[1] + d[2]*d[2]) / h, a = (1-q)*(1-q)*(1-q);
      if (q >= 1) continue;
      double t = w[j] * a * (parts == 1 ? (1-q) * (1 + 4*q) : (p[i] + p[j]) * d[c]);
      if (way == 2) part[k % 4] += t;
      else if (way == 3) { double y = t - lost, s = sum + y; lost = (s - sum) - y; sum = s; }
      else sum += t;
    }
    out[parts*i + c] = sum + ((part[0] + part[1]) + (part[2] + part[3]));
  }
}
"""
FORTRAN = """
subroutine sums(n, way, parts, x, w, p, h, out) bind(c)
  use iso_c_binding
  integer(c_int64_t), value :: n, way, parts
  real(c_double), value :: h
  real(c_double), intent(in) :: x(3, n), w(n), p(n)
  real(c_double), intent(out) :: out(parts, n)
  integer(c_int64_t) :: i, j, k, c
  real(c_double) :: total, lost, part(0:3), d(3), q, t, y, s
  do i = 1, n
    do c = 1, parts
      total = 0; lost = 0; part = 0
      do k = 1, n
        j = merge(n + 1 - k, k, way == 1)
        d = x(:, i) - x(:, j)
        q = sqrt(sum(d**2)) / h
        if (q >= 1) cycle
        t = w(j) * (1 - q)**3 * merge((1 - q) * (1 + 4 * q), (p(i) + p(j)) * d(c), parts == 1)
        if (way == 2) then
          part(mod(k, 4_c_int64_t)) = part(mod(k, 4_c_int64_t)) + t
        else if (way == 3) then
          y = t - lost; s = total + y; lost = (s - total) - y; total = s
        else
          total = total + t
        end if
      end do
      out(c, i) = total + sum(part)
    end do
  end do
end subroutine
"""
RUST = """
#[no_mangle]
pub unsafe extern "C" fn sums(n: i64, way: i64, parts: i64, x: *const f64, w: *const f64, p: *const f64, h: f64,
                              out: *mut f64) {
    let at = |v: *const f64, k: i64| unsafe { *v.offset(k as isize) };
    for i in 0..n { for c in 0..parts {
        let (mut sum, mut lost, mut part) = (0.0f64, 0.0f64, [0.0f64; 4]);
        for k in 0..n {
            let j = if way == 1 { n - 1 - k } else { k };
            let d = [0, 1, 2].map(|c| at(x, 3 * i + c) - at(x, 3 * j + c));
            let q = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt() / h;
            if q >= 1.0 { continue; }
            let f = if parts == 1 { (1.0 - q) * (1.0 + 4.0 * q) } else { (at(p, i) + at(p, j)) * d[c as usize] };
            let t = at(w, j) * (1.0 - q).powi(3) * f;
            if way == 2 { part[(k % 4) as usize] += t; }
            else if way == 3 { let y = t - lost; let s = sum + y; lost = (s - sum) - y; sum = s; }
            else { sum += t; }
        }
        unsafe { *out.offset((parts * i + c) as isize) = sum + ((part[0] + part[1]) + (part[2] + part[3])); }
    } }
}
"""
ZIG = """
export fn sums(n: i64, way: i64, parts: i64, x: [*]const f64, w: [*]const f64, p: [*]const f64, h: f64,
    out: [*]f64) void {
    const count: usize = @intCast(n);
    const wide: usize = @intCast(parts);
    for (0..count) |i| for (0..wide) |c| {
        var sum: f64 = 0;
        var lost: f64 = 0;
        var part = [4]f64{ 0, 0, 0, 0 };
        for (0..count) |k| {
            const j = if (way == 1) count - 1 - k else k;
            const d = [3]f64{ x[3 * i] - x[3 * j], x[3 * i + 1] - x[3 * j + 1], x[3 * i + 2] - x[3 * j + 2] };
            const q = @sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]) / h;
            if (q >= 1) continue;
            const a = w[j] * (1 - q) * (1 - q) * (1 - q);
            const t = a * (if (wide == 1) (1 - q) * (1 + 4 * q) else (p[i] + p[j]) * d[c]);
            if (way == 2) {
                part[k % 4] += t;
            } else if (way == 3) {
                const y = t - lost;
                const s = sum + y;
                lost = (s - sum) - y;
                sum = s;
            } else {
                sum += t;
            }
        }
        out[wide * i + c] = sum + ((part[0] + part[1]) + (part[2] + part[3]));
    };
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
