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
