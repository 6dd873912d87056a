"""The scene file that tests of commands, studies and sweeps share: liquid in the plane that nothing holds."""

from tests.running import rows

TANK = rows(__file__, "tank")
GRAVITY = rows(__file__, "gravity")


def tank(end_time, across=4, up=6, more=""):
    """Text of a block of `across` times `up` particles, with further effects."""
    return TANK.format(end_time=end_time, across=across, up=up) + more
