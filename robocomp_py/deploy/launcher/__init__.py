"""Launching on one machine. `local.py` has the agent; `keeper.py` and `forkserver.py` are programs that it runs."""
