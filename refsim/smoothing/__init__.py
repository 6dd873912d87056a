"""Smoothing kernels: poly6, spiky, cubic spline, Wendland C2 and the viscosity Laplacian, in 2D and 3D."""

from refsim.smoothing.shapes import SHAPES, Smoothing, lattice, lattice_neighbours, smoothing

__all__ = ["SHAPES", "Smoothing", "lattice", "lattice_neighbours", "smoothing"]
