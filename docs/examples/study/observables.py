"""Observables of the worked examples of docs/study.md: functions of a simulation."""

import numpy as np

DIRECTIONS, CONE = 200, np.radians(10)


def radius_variation(simulation):
    """std/mean over 200 Fibonacci directions of the greatest distance from the centre within 10 degrees of each."""
    offset = simulation.field("position").astype(float)
    offset -= offset.mean(0)
    radius = np.linalg.norm(offset, axis=1)
    number = np.arange(DIRECTIONS)
    z = 1 - (2 * number + 1) / DIRECTIONS
    angle = np.pi * (3 - np.sqrt(5)) * number
    ring = np.sqrt(1 - z**2)
    axis = np.column_stack([ring * np.cos(angle), ring * np.sin(angle), z])
    within = offset @ axis.T > np.cos(CONE) * radius[:, None]
    outermost = np.where(within, radius[:, None], 0.0).max(axis=0)
    return outermost.std() / outermost.mean()


def molten(simulation):
    """Share of the latent heat that the block has taken up, from 0 to 1."""
    block = slice(simulation.plan.state.sizes[0])  # the first part of the scene
    enthalpy, latent_heat = simulation.field("enthalpy")[block], simulation.field("latent_heat")[block]
    return np.clip(enthalpy / latent_heat, 0, 1).mean()
