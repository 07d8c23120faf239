"""Drives a robot around, or to a place."""
