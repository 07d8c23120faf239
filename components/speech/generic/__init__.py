# Generated from speech.cdsl by rcgen 0.1.0: edits are lost.
"""The part of speech that rcgen rewrites on every run."""
