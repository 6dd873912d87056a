"""What one particle feels in a frame that turns."""

from refsim.backends.compile import kernel
from refsim.motion.formulas import turning_acceleration


@kernel
def turning(i, position, velocity, turning, acceleration):
    """Euler, centrifugal and Coriolis acceleration; added to the acceleration [m/s^2]."""
    r = (position[i, 0] - turning[6], position[i, 1] - turning[7], position[i, 2] - turning[8])
    v = (velocity[i, 0], velocity[i, 1], velocity[i, 2])
    w = (turning[0], turning[1], turning[2])
    ax, ay, az = turning_acceleration(r, v, w, (turning[3], turning[4], turning[5]))
    acceleration[i, 0] += ax
    acceleration[i, 1] += ay
    acceleration[i, 2] += az
