# Generated from plain.cdsl by rcgen 0.1.0: edits are lost.
"""The part of plain that rcgen rewrites on every run."""
