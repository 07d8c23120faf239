"""The component import."""
