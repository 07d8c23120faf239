"""The component plain."""
