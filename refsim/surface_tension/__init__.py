"""Surface tension of free surfaces: one folder for each published model."""
