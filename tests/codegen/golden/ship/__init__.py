"""The component ship."""
