"""The mission: find somebody, and do not run out of battery."""
