"""Scenes: shapes and solids, scene files, and the plan made from them."""
