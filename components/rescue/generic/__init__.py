# Generated from rescue.cdsl by rcgen 0.1.0: edits are lost.
"""The part of rescue that rcgen rewrites on every run."""
