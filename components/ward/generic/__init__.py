# Generated from ward.cdsl by rcgen 0.1.0: edits are lost.
"""The part of ward that rcgen rewrites on every run."""
