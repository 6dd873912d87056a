"""Runs of panels of error against time that no packaged scene gives."""
