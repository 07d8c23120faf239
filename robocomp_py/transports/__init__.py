"""Ways to carry payloads. `base` is the contract; the rest are adapters, found by entry point."""
