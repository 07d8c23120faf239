"""Components for robots in Python, whatever the middleware.

Nothing is imported here: using one layer must not load them all.
"""

__version__ = "0.1.0"
