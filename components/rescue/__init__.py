"""The mission: find a victim before the battery is empty."""
