// sph.density over all pairs, Wendland C2 and cubic spline, held to a file of its test vectors: density FILE.npz
#include <algorithm>
#include <cstdio>
#include <vector>

#include "refsim_vectors.h"

enum { CUBIC_SPLINE = 2, WENDLAND_C2 = 3 }; // of smoothing.shape

template <class Real> Real kernel(int shape, Real q)
{
    if (q >= 1)
        return 0;
    if (shape == WENDLAND_C2)
        return std::pow(1 - q, 4) * (1 + 4 * q);
    return q <= Real(0.5) ? 1 - 6 * q * q * (1 - q) : 2 * std::pow(1 - q, 3);
}

template <class Real> std::vector<Real> density(const refsim::Case &c, int shape)
{
    const std::vector<Real> x = c.get<Real>("position"), mass = c.get<Real>("mass");
    const Real h = c.number<Real>("smoothing.support_radius"), scale = c.number<Real>("smoothing.value_scale");
    std::vector<Real> density = c.get<Real>("before/density");
    for (std::size_t i = 0; i < mass.size(); i++) {
        density[i] = 0;
        for (std::size_t j = 0; j < mass.size(); j++) {
            const Real dx = x[3 * i] - x[3 * j], dy = x[3 * i + 1] - x[3 * j + 1], dz = x[3 * i + 2] - x[3 * j + 2];
            const Real weight = kernel(shape, std::sqrt(dx * dx + dy * dy + dz * dz) / h);
            if (weight > 0) // far away a NaN is none of i's business
                density[i] += mass[j] * scale * weight;
        }
    }
    return density;
}

template <class Real> int judge(const refsim::Vectors &file)
{
    int failed = 0, judged = 0;
    for (const refsim::Case &c : file.cases()) {
        const int shape = c.number<int>("smoothing.shape");
        if (shape != WENDLAND_C2 && shape != CUBIC_SPLINE)
            continue; // a kernel that this code does not have
        const std::vector<Real> mine = density<Real>(c, shape);
        const refsim::Worst worst = c.compare("density", mine);
        const bool steady = refsim::same_bits(mine, density<Real>(c, shape));
        judged++;
        if (!worst.holds() || !steady) {
            failed++;
            std::printf("%s: %.3g of the bound at particle %ld%s\n", c.name.c_str(), worst.error, worst.row,
                        steady ? "" : ", and another answer in another call");
        }
    }
    std::printf("%d of %d cases hold\n", judged - failed, judged);
    return failed || !judged;
}

int main(int argc, char **argv)
{
    if (argc != 2)
        return std::fprintf(stderr, "usage: density FILE.npz\n"), 2;
    const refsim::Vectors file(argv[1]);
    return file.cases()[0].entry("position").width == 4 ? judge<float>(file) : judge<double>(file);
}
