# Generated from handover.cdsl by rcgen 0.1.0: edits are lost.
"""The part of handover that rcgen rewrites on every run."""
