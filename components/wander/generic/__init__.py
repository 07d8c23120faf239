# Generated from wander.cdsl by rcgen 0.1.0: edits are lost.
"""The part of wander that rcgen rewrites on every run."""
