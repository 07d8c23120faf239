"""Of robocomp_py. In a file of its own, so that any layer may tell it."""

__version__ = "0.1.0"
