"""The component patrol."""
