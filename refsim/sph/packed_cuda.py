"""Fields of a particle that a loop over neighbours reads together, four numbers a row."""

from refsim.backends import device


def places_with_masses(position, mass, scratch):
    """Rows (x, m) in scratch memory."""
    placed = scratch.array("placed", (position.shape[0], 4), position.dtype)
    device.packed((position,), (mass,), (placed,))
    return placed


def packed_fields(position, velocity, mass, density, pressure, normal, scratch):
    """Rows (x, m), (v, p) and, unless `normal` is None, (normal, density) in scratch memory."""
    names = ("placed", "moving") if normal is None else ("placed", "moving", "directed")
    rows = tuple(scratch.array(name, (position.shape[0], 4), position.dtype) for name in names)
    if normal is None:
        device.packed((position, velocity), (mass, pressure), rows)
        return (*rows, None)
    device.packed((position, velocity, normal), (mass, pressure, density), rows)
    return rows
