# Generated from arm.cdsl by rcgen 0.1.0: edits are lost.
"""The part of arm that rcgen rewrites on every run."""
