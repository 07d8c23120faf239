"""DDSL: deployments, networks of component instances."""
