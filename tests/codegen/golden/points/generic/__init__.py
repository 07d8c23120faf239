# Generated from points.cdsl by rcgen 0.1.0: edits are lost.
"""The part of points that rcgen rewrites on every run."""
