"""The experiments: a folder in here whose module `experiment` has an `EXPERIMENT` is one (`validation.experiment`)."""
