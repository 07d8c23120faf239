"""The components of a network, each a process of its own, follow the clock of one of them: in lock-step, or freely."""
