# Generated from towers.cdsl by rcgen 0.1.0: edits are lost.
"""The part of towers that rcgen rewrites on every run."""
