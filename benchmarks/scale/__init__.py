"""Measures what a network costs as it grows: ours, and the bare library in the same run."""
