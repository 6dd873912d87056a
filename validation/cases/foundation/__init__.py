"""The liquid that every system stands on: its hard cases (`stability.py`)."""
