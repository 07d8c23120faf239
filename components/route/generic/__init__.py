# Generated from route.cdsl by rcgen 0.1.0: edits are lost.
"""The part of route that rcgen rewrites on every run."""
