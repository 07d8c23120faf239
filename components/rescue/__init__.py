"""The mission: find who needs help, call for help, and do not run out of battery."""
