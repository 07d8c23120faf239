"""Benchmarks: every claim about speed is a command here that measures ours and the raw library in one run."""
