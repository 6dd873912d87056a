"""Region sums by parallel reduction: the threads of a block share a region (Shao & Song 2017, section 3.2)."""
