# Generated from ship.cdsl by rcgen 0.1.0: edits are lost.
"""The part of ship that rcgen rewrites on every run."""
