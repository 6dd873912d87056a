"""The papers' experiments: cases, what they measure, their pictures, and the verdicts on them.

`python -m validation [CASE] [--quick]`. Every module in `validation.experiments` that exports a `CASE` takes part.
"""
