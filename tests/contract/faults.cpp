// A density by summation with one planted fault, for tests/contract/test_faults.py. REAL is float or double.
#include <cmath>
#include <cstdint>
#include <thread>
#include <vector>

namespace {
enum Fault { NONE, SELF, NORM, CAP, RACE, UNSET, HALF, MIRROR, IMAGE, PREFIX, EDGE };
const double PI = 3.14159265358979323846;

struct Kernel {
    REAL radius;
    REAL scale;
    int cubic;
    bool cut;
    REAL operator()(REAL r) const {
        const REAL q = r / radius, a = 1 - q;
        if (cut && q >= 1) return 0;
        if (cubic) return scale * (q <= REAL(0.5) ? 1 - 6 * q * q * a : 2 * a * a * a);
        return scale * a * a * a * a * (1 + 4 * q);
    }
};

REAL distance(const REAL *a, const REAL *b, const REAL *period, bool both) {
    REAL square = 0;
    for (int c = 0; c < 3; ++c) {
        REAL d = a[c] - b[c];
        if (period && period[c] > 0) {
            if (both) d -= period[c] * std::round(d / period[c]);
            else if (d > period[c] / 2) d -= period[c];
        }
        square += d * d;
    }
    return std::sqrt(square);
}
}  // namespace

extern "C" void density(int fault, int cubic, int dim, REAL h, int64_t n, const REAL *x, const REAL *mass, int64_t walls,
                        const REAL *wall_x, const REAL *wall_volume, REAL rest, const REAL *period, REAL *rho) {
    const int space = fault == NORM ? 3 : dim;
    const REAL radius = fault == HALF ? h / 2 : h;
    const double norm = cubic ? (space == 2 ? 40 / (7 * PI) : 8 / PI) : (space == 2 ? 7 / PI : 21 / (2 * PI));
    const Kernel w{radius, REAL(norm / std::pow(double(radius), space)), cubic, fault != EDGE};
    if (fault == RACE) {
        std::vector<std::thread> threads;
        for (int64_t i = 0; i < n; ++i) rho[i] = mass[i] * w(0);
        for (int t = 0; t < 4; ++t)
            threads.emplace_back([=] {
                for (int64_t i = t; i < n; i += 4)
                    for (int64_t j = 0; j < n; ++j) {
                        const REAL part = i == j ? 0 : mass[i] * w(distance(x + 3 * i, x + 3 * j, period, true));
                        if (part == 0) continue;
                        volatile REAL *sum = rho + j;
                        const REAL before = *sum;
                        std::this_thread::yield();
                        *sum = before + part;
                    }
            });
        for (auto &thread : threads) thread.join();
        return;
    }
    for (int64_t i = 0; i < n; ++i) {
        REAL sum = fault == SELF ? 0 : mass[i] * w(0);
        int64_t found = 0;
        for (int64_t j = 0; j < n; ++j) {
            if (j == i) continue;
            const REAL r = distance(x + 3 * i, x + 3 * j, period, fault != IMAGE);
            if (fault != EDGE && r >= radius) continue;
            if (fault == CAP && ++found > 64) break;
            sum += mass[j] * w(r);
        }
        for (int64_t b = 0; b < walls; ++b) {
            REAL place[3] = {wall_x[3 * b], wall_x[3 * b + 1], wall_x[3 * b + 2]};
            if (fault == MIRROR) place[dim - 1] = -place[dim - 1];
            sum += rest * wall_volume[b] * w(distance(x + 3 * i, place, period, true));
        }
        rho[i] = fault == UNSET ? rho[i] + sum : sum;
    }
}

// Over a list of neighbours, whose contributions are summed in single precision for all particles at once.
extern "C" void prefix(int fault, int cubic, int dim, REAL h, int64_t n, const REAL *x, const REAL *mass,
                       const int64_t *start, const int32_t *count, const uint32_t *entries, REAL *rho) {
    const double norm = cubic ? (dim == 2 ? 40 / (7 * PI) : 8 / PI) : (dim == 2 ? 7 / PI : 21 / (2 * PI));
    const Kernel w{h, REAL(norm / std::pow(double(h), dim)), cubic, true};
    float running = 0;
    for (int64_t i = 0; i < n; ++i) {
        const float before = running;
        REAL own = mass[i] * w(0);
        for (int32_t k = 0; k < count[i]; ++k) {
            const int64_t j = entries[start[i] + k];
            const REAL part = mass[j] * w(distance(x + 3 * i, x + 3 * j, nullptr, true));
            if (fault == PREFIX) running += float(part);
            else own += part;
        }
        rho[i] = own + (running - before);
    }
}
