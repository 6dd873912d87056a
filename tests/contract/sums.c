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
