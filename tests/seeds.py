"""The seeds with which simulated stories are told."""

SEEDS = range(20)
