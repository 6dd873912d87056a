"""Boundaries: walls of particles, sampled meshes, coupling. One folder per published method."""
