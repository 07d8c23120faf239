"""Moves the tool of an arm in a straight line to a pose."""
