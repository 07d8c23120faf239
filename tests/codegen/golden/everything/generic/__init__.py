# Generated from everything.cdsl by rcgen 0.1.0: edits are lost.
"""The part of everything that rcgen rewrites on every run."""
