"""The component everything."""
