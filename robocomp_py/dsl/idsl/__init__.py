"""IDSL: interfaces and the types of their messages."""
