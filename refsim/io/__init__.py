"""Files that a run writes and reads: frames, journals, checkpoints."""
