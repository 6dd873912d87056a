"""The scene file that tests of commands, studies and sweeps share: liquid in the plane that nothing holds."""

TANK = """
spacing = 0.01
support_radius = 0.02
dim = 2
end_time = {end_time}

[[fluid]]
shape = "box"
cells = [{across}, {up}, 1]

[effects.weakly_compressible]
density = "summation"
sound_speed = 20.0
dynamic_viscosity = 2.0
"""
GRAVITY = """
[effects.gravity]
acceleration = [0.0, -9.81, 0.0]
"""


def tank(end_time, across=4, up=6, more=""):
    """Text of a block of `across` times `up` particles, with further effects."""
    return TANK.format(end_time=end_time, across=across, up=up) + more
