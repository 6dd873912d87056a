"""Laws that hold in every scene, and scenes drawn at random: `python -m validation laws`."""
