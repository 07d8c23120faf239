"""A robot in a house, seen from above: what it is driven to do, what it measures, what its battery holds."""
