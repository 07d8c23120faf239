# Generated from patrol.cdsl by rcgen 0.1.0: edits are lost.
"""The part of patrol that rcgen rewrites on every run."""
