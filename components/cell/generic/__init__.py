# Generated from cell.cdsl by rcgen 0.1.0: edits are lost.
"""The part of cell that rcgen rewrites on every run."""
