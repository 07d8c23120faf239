# Generated from names.cdsl by rcgen 0.1.0: edits are lost.
"""The part of import that rcgen rewrites on every run."""
