"""Drives a robot around, or to a place, and past whatever is in the way."""
