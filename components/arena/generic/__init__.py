# Generated from arena.cdsl by rcgen 0.1.0: edits are lost.
"""The part of arena that rcgen rewrites on every run."""
