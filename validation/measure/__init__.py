"""Measurements behind packaged tables, apart from the experiments: `python -m validation measure`."""
