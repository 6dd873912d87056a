"""Core: operations (equation, programs, registry), effects, fields, wall particles, hard inputs, errors.

Imports nothing of refsim but itself."""
