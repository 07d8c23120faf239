"""A voice that speaks in the log."""
