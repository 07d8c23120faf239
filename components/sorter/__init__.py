"""Takes parts from a conveyor by two arms."""
