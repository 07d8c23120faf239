"""Reads the code that users write, and never runs it: what its classes define and lack, what a new name changes."""
