"""Launching on one machine. `local.py` has the agent; `keeper.py` and `zygote.py` are programs that it runs."""
