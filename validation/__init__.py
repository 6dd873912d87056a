"""The papers' experiments, what they measure, their pictures, and the checks on them: `python -m validation`.

A folder of `validation.experiments` is one experiment (`validation.experiment`).
"""
