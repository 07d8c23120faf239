"""The component towers."""
