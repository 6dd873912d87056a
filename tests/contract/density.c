#include <math.h>
#include "density.h"
void sph_density(int64_t n, const REAL *x, const REAL *m, const refsim_neighbours *near, const refsim_walls *walls,
                 const refsim_smoothing *w, const refsim_fluid *fluid, const refsim_period *period, REAL *count,
                 REAL *asymmetry, REAL *density) {
    for (int64_t i = 0; i < n; i++) {
        REAL sum = m[i];
        for (int32_t k = 0; k < near->count[i]; k++) {
            int64_t j = near->entries[near->start[i] + k];
            REAL d[3] = {x[3*i] - x[3*j], x[3*i+1] - x[3*j+1], x[3*i+2] - x[3*j+2]};
            REAL q = sqrt(d[0]*d[0] + d[1]*d[1] + d[2]*d[2]) * w->inverse_radius, a = 1 - q;
            if (q < 1) sum += m[j] * a * a * a * a * (1 + 4 * q);
        }
        density[i] = w->value_scale * sum;
        if (walls) for (int64_t b = 0; b < walls->rows; b++) {
            const REAL *y = walls->position + 3 * b;
            REAL d[3] = {x[3*i] - y[0], x[3*i+1] - y[1], x[3*i+2] - y[2]};
            REAL q = sqrt(d[0]*d[0] + d[1]*d[1] + d[2]*d[2]) * w->inverse_radius, a = 1 - q;
            REAL filled = fluid->rest_density * walls->volume[b];
            if (q < 1) density[i] += filled * w->value_scale * a * a * a * a * (1 + 4 * q);
        }
    }
}
