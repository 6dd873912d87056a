// mpm.particle_to_grid, MLS-MPM with quadratic B-splines, held to a file of its test vectors of variant 0.
#include <array>
#include <cstdio>
#include <map>
#include <vector>

#include "refsim_vectors.h"

using Node = std::array<long, 3>;

template <class Real> int judge(const refsim::Vectors &file)
{
    int failed = 0;
    for (const refsim::Case &c : file.cases()) {
        const auto x = c.get<Real>("position"), v = c.get<Real>("velocity"), m = c.get<Real>("mass");
        const auto a = c.get<Real>("affine"), ratio = c.get<Real>("volume_ratio"), step = c.get<Real>("timestep");
        const double h = c.number<double>("background.cell_size");
        const bool flat = c.number<int>("background.layers") == 1; // z = 0 everywhere
        const auto nodes = c.get<long>("nodes");
        std::map<Node, long> number;
        for (long j = 0; j < c.rows("nodes"); j++)
            number[{nodes[3 * j], nodes[3 * j + 1], nodes[3 * j + 2]}] = j;
        std::vector<Real> mass(number.size(), 0), momentum(3 * number.size(), 0);
        for (std::size_t p = 0; p < m.size(); p++) {
            Node base = {0, 0, 0};
            double weight[3][3] = {{0, 0, 0}, {0, 0, 0}, {1, 0, 0}}, from[3] = {0, 0, 0}; // from the base, in cells
            for (int d = 0; d < (flat ? 2 : 3); d++) {
                const double place = x[3 * p + d] / h; // in float64: it may be far from the origin
                base[d] = long(std::floor(place - 0.5));
                const double u = from[d] = place - base[d];
                weight[d][0] = 0.5 * (1.5 - u) * (1.5 - u);
                weight[d][1] = 0.75 - (u - 1) * (u - 1);
                weight[d][2] = 0.5 * (u - 0.5) * (u - 0.5);
            }
            const bool linear = c.number<int>("liquid.linear_stress"), unit = c.number<int>("liquid.unit_volume");
            const Real volume = unit ? 1 : m[p] / c.number<Real>("liquid.rest_density");
            const Real stress = c.number<Real>("liquid.stress") * (ratio[p] - 1) * (linear ? 1 : ratio[p]);
            const Real push = Real(4 / (h * h)) * step[1] * volume * stress;
            for (int k = 0; k < (flat ? 9 : 27); k++) {
                const int off[3] = {k % 3, k / 3 % 3, k / 9};
                const Real w = Real(weight[0][off[0]] * weight[1][off[1]] * weight[2][off[2]]);
                const long j = number.at({base[0] + off[0], base[1] + off[1], base[2] + off[2]});
                Real arm[3];
                for (int d = 0; d < 3; d++)
                    arm[d] = Real(h * (off[d] - from[d]));
                mass[j] += w * m[p];
                for (int d = 0; d < 3; d++) {
                    const Real *row = &a[9 * p + 3 * d];
                    const Real field = v[3 * p + d] + row[0] * arm[0] + row[1] * arm[1] + row[2] * arm[2];
                    momentum[3 * j + d] += w * (m[p] * field - push * arm[d]);
                }
            }
        }
        for (const refsim::Worst &worst : {c.compare("node_mass", mass), c.compare("node_momentum", momentum)})
            if (!worst.holds()) {
                failed++;
                std::printf("%s: %.3g of the bound at node %ld\n", c.name.c_str(), worst.error, worst.row);
            }
    }
    std::printf("%zu cases, %d wrong outputs\n", file.cases().size(), failed);
    return failed || file.cases().empty();
}

int main(int argc, char **argv)
{
    if (argc != 2)
        return std::fprintf(stderr, "usage: particle_to_grid FILE.npz\n"), 2;
    const refsim::Vectors file(argv[1]);
    return file.cases()[0].entry("position").width == 4 ? judge<float>(file) : judge<double>(file);
}
