/* Three operations over neighbour lists, with the kernel Wendland C2; -DREAL=float or -DREAL=double. */
#include <math.h>
#include <stdint.h>

typedef struct { const int64_t *start; const int32_t *count; const uint32_t *entries; } list;
typedef struct { REAL support_radius, inverse_radius, value_scale, slope_scale, laplacian_scale; } smoothing;

/* x_i - x_j in d and its length; the list reaches further than the support radius. */
static REAL apart(const REAL *x, int64_t i, int64_t j, REAL d[3])
{
    REAL squared = 0;
    for (int c = 0; c < 3; c++) {
        d[c] = x[3 * i + c] - x[3 * j + c];
        squared += d[c] * d[c];
    }
    return (REAL)sqrt(squared);
}

static REAL fourth(REAL a) { return a * a * a * a; }

/* sph.density: rho_i = sum_j m_j W_ij, the particle itself included [kg/m^dim] */
void density(int64_t n, const REAL *x, const REAL *mass, list near, smoothing w, REAL *rho)
{
    for (int64_t i = 0; i < n; i++) {
        REAL sum = mass[i], d[3];
        for (int32_t k = 0; k < near.count[i]; k++) {
            const int64_t j = near.entries[near.start[i] + k];
            const REAL q = apart(x, i, j, d) * w.inverse_radius;
            if (q < 1)
                sum += mass[j] * fourth(1 - q) * (1 + 4 * q);
        }
        rho[i] = w.value_scale * sum;
    }
}

/* sph.momentum: pressure J(10) and, for mu != 0, viscosity J(11), added to the acceleration [m/s^2] */
void momentum(int64_t n, const REAL *x, const REAL *v, const REAL *mass, const REAL *rho, const REAL *p, list near,
              smoothing w, REAL share, REAL mu, REAL *a)
{
    for (int64_t i = 0; i < n; i++) {
        REAL sum[3] = {0, 0, 0}, d[3];
        for (int32_t k = 0; k < near.count[i]; k++) {
            const int64_t j = near.entries[near.start[i] + k];
            const REAL q = apart(x, i, j, d) * w.inverse_radius;
            if (q >= 1)
                continue;
            const REAL volume = mass[j] / rho[j];
            const REAL slope_over_r = w.slope_scale * w.inverse_radius * -20 * (1 - q) * (1 - q) * (1 - q);
            const REAL f = -share * volume * (p[i] + p[j]) * slope_over_r;
            for (int c = 0; c < 3; c++)
                sum[c] += f * d[c];
            if (mu != 0)
                for (int c = 0; c < 3; c++)
                    sum[c] += mu * volume * w.laplacian_scale * (1 - q) * (v[3 * j + c] - v[3 * i + c]);
        }
        for (int c = 0; c < 3; c++)
            a[3 * i + c] += sum[c] / rho[i];
    }
}

/* becker_teschner_2007.cohesion: a_i -= strength/m_i sum_j m_j s(max(q, least)) x_ij, s the cubic spline, s(0) = 1 */
void cohesion(int64_t n, const REAL *x, const REAL *mass, list near, smoothing w, REAL strength, REAL least, REAL *a)
{
    for (int64_t i = 0; i < n; i++) {
        REAL sum[3] = {0, 0, 0}, d[3];
        for (int32_t k = 0; k < near.count[i]; k++) {
            const int64_t j = near.entries[near.start[i] + k];
            REAL q = apart(x, i, j, d) * w.inverse_radius;
            if (q >= 1)
                continue;
            q = q > least ? q : least;
            const REAL s = q <= (REAL)0.5 ? 1 - 6 * q * q * (1 - q) : 2 * (1 - q) * (1 - q) * (1 - q);
            for (int c = 0; c < 3; c++)
                sum[c] -= mass[j] * s * d[c];
        }
        for (int c = 0; c < 3; c++)
            a[3 * i + c] += strength / mass[i] * sum[c];
    }
}
