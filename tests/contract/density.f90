submodule (refsim_sph_density) mine
contains
  module procedure sph_density
    integer(c_int64_t) :: i, j
    real(real_kind) :: q(n)
    do i = 1, n
      do j = 1, n
        q(j) = min(sqrt(sum((position(:, i) - position(:, j))**2)) * smoothing%inverse_radius, 1.0_c_double)
      end do
      density(i) = smoothing%value_scale * sum(mass * (1 - q)**4 * (1 + 4 * q))
    end do
  end procedure
end submodule
