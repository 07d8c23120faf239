"""Shared by the command lines of the benchmarks."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable


def some_of(known: tuple[str, ...]) -> Callable[[str], tuple[str, ...]]:
    def chosen(text: str) -> tuple[str, ...]:
        names = tuple(text.split(","))
        for name in names:
            if name not in known:
                raise argparse.ArgumentTypeError(f"no `{name}`; there are {', '.join(known)}")
        return names

    return chosen


def tell(text: str) -> None:
    """Show the progress, on one line if stderr is a terminal."""
    if sys.stderr.isatty():
        print(f"\r\033[K{text}", end="", file=sys.stderr, flush=True)
    elif text:
        print(text, file=sys.stderr, flush=True)
