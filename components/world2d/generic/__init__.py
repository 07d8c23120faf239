# Generated from world2d.cdsl by rcgen 0.1.0: edits are lost.
"""The part of world2d that rcgen rewrites on every run."""
