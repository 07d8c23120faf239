"""A voice: says things in the log, a word at a time."""
