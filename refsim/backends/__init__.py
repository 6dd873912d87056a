"""Backends: arrays, compiling, CUDA graphs, scans and reductions."""
