"""What one particle feels in a frame that turns."""

from refsim.backends.compile import kernel
from refsim.motion.formulas import felt


@kernel
def turning(i, position, velocity, turning, acceleration):
    """Euler, centrifugal and Coriolis acceleration; added to the acceleration [m/s^2]."""
    zero = type(position[i, 0])(0)
    ax, ay, az = felt(i, position, velocity, (zero, zero, zero), turning)
    acceleration[i, 0] += ax
    acceleration[i, 1] += ay
    acceleration[i, 2] += az
