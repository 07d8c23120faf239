"""Two arms hand over a bottle, back and forth."""
