"""Lock-step: the components of a network, each in its own process, follow the clock of one of them."""
