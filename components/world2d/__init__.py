"""A house with a robot in it, seen from above."""
