"""PDSL: the parameters of a component."""
