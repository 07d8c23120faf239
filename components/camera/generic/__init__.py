# Generated from camera.cdsl by rcgen 0.1.0: edits are lost.
"""The part of camera that rcgen rewrites on every run."""
