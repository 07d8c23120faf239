"""Shipped for tests of components and of transports."""
