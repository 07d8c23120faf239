"""Models to files. Text is in templates; what needs thought is in filters."""
