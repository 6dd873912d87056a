"""Engine: the time loop, step sizes, whole runs and what is said of one that failed."""
