/* sph.density held to its test vectors: density_vectors FILE CASE prints the largest error over bound; 0 if it holds. */
#include <math.h>

#include "vectors.h"

static double *of(const char *file, const char *kase, const char *name, long *count)
{
    char path[200];
    snprintf(path, sizeof path, "%s/%s", kase, name);
    return values(file, path, count);
}

int main(int argc, char **argv)
{
    long n = 0, k;
    double *x = argc == 3 ? of(argv[1], argv[2], "position", &n) : NULL;
    if (!x)
        return fprintf(stderr, "usage: density_vectors FILE CASE, with a case of the file\n"), 2;
    double *mass = of(argv[1], argv[2], "mass", &n), h = *of(argv[1], argv[2], "smoothing.support_radius", &k);
    double scale = *of(argv[1], argv[2], "smoothing.value_scale", &k), worst = 0;
    double *answer = of(argv[1], argv[2], "answer/density", &k), *bound = of(argv[1], argv[2], "bound/density", &k);
    for (long i = 0; i < n; i++) {
        double sum = 0;
        for (long j = 0; j < n; j++) {
            const double *a = x + 3 * i, *b = x + 3 * j;
            const double q = hypot(hypot(a[0] - b[0], a[1] - b[1]), a[2] - b[2]) / h;
            sum += q < 1 ? mass[j] * pow(1 - q, 4) * (1 + 4 * q) : 0;
        }
        worst = fmax(worst, fabs(scale * sum - answer[i]) / bound[i]);
    }
    printf("%s: %ld particles, largest error %.3g of the bound\n", argv[2], n, worst);
    return worst <= 1 ? 0 : 1;
}
