"""Engine: the time loop, lengths of steps, neighbour lists, whole runs, post-mortem."""
