"""What this transport takes from Ice for Python beyond its public interface.

what   written for       if the probe fails
free   zeroc-ice 3.7.11  each one-way request keeps its memory, payload included, as long as the process
"""

from __future__ import annotations

from typing import Any


def free(sending: Any) -> None:
    """Free a one-way request that was sent. Its future and the result of Ice refer to each other, unseen by Python."""
    if hasattr(sending, "_asyncResult"):
        sending._asyncResult = None
