# Generated from sorter.cdsl by rcgen 0.1.0: edits are lost.
"""The part of sorter that rcgen rewrites on every run."""
