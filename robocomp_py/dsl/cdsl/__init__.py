"""CDSL: components, their ports and options."""
