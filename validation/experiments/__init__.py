"""The cases: every module in here that exports a `CASE` (`validation.harness.Case`) is found and run."""
