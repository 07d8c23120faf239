"""The component points."""
