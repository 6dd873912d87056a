"""CUDA C on CuPy's arrays under the contract: `refsim contract cupy_backend.py`. CuPy compiles it for each dtype."""

import cupy

from refsim.contract import Programs

SOURCE = r"""
// sph.density: rho_i = sum_j m_j W_ij, the particle itself included [kg/m^dim]
template <typename real> __global__ void density(
    int n, const real *x, const real *mass, const int *count, const unsigned *entries, real inverse_radius,
    real value_scale, real *rho)
{
    const int i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= n)
        return;
    real sum = mass[i];
    for (int k = 0; k < count[i]; k++) {
        const long long j = entries[(long long)k * n + i];
        const real dx = x[3 * i] - x[3 * j], dy = x[3 * i + 1] - x[3 * j + 1], dz = x[3 * i + 2] - x[3 * j + 2];
        const real q = sqrt(dx * dx + dy * dy + dz * dz) * inverse_radius, a = 1 - q;
        if (q < 1)
            sum += mass[j] * a * a * a * a * (1 + 4 * q);
    }
    rho[i] = value_scale * sum;
}

// sph.gravity: the acceleration of a field, added [m/s^2]
template <typename real> __global__ void gravity(int n, const real *field, real *acceleration)
{
    const int i = blockIdx.x * blockDim.x + threadIdx.x;
    for (int c = 0; c < 3 && i < n; c++)
        acceleration[3 * i + c] += field[c];
}
"""
NAMES = {("density", "f"): "density<float>", ("density", "d"): "density<double>"}
NAMES |= {("gravity", "f"): "gravity<float>", ("gravity", "d"): "gravity<double>"}
MODULE = cupy.RawModule(code=SOURCE, options=("-std=c++11",), name_expressions=tuple(NAMES.values()))


def launched(name, dtype, n, *values):
    kernel = MODULE.get_function(NAMES[name, dtype.char])
    kernel(((n + 127) // 128,), (128,), (cupy.int32(n), *values))


def density(position, mass, neighbours, smoothing, density):
    numbers = smoothing.inverse_radius, smoothing.value_scale
    if len(mass):
        launched(
            "density", mass.dtype, len(mass), position, mass, neighbours.count, neighbours.entries, *numbers, density
        )


def gravity(field, acceleration):
    if len(acceleration):
        launched("gravity", acceleration.dtype, len(acceleration), field, acceleration)


PROGRAMS = Programs(
    {"sph.density": density, "sph.gravity": gravity}, arrays="cuda", convert=cupy.asarray, kernels=("wendland_c2",),
    walls=False, without=("number_density", "asymmetry", "period"),
)  # fmt: skip
