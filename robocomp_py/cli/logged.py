"""Which lines of logs are shown: options that commands share, and the test of a line."""

from __future__ import annotations

import argparse
import math
import re
import time
from dataclasses import dataclass

from .completing import completed

LEVELS = ("debug", "info", "warning", "error", "critical")

_UNITS = {"s": 1.0, "m": 60.0, "h": 3600.0, "d": 86400.0}
_AGO = re.compile(r"(\d+(?:\.\d+)?)([smhd]?)")


@dataclass(frozen=True)
class Wanted:
    level: str = ""
    """Only records of this level or above it. What was printed has no level, and is left out."""
    since: float = 0.0
    """Seconds since the Unix epoch."""
    grep: re.Pattern[str] | None = None

    @property
    def everything(self) -> bool:
        return self == Wanted()

    def __call__(self, at: float, level: str, text: str) -> bool:
        """`level` is in capitals or not; "" for what was printed."""
        if self.level and (not level or LEVELS.index(level.lower()) < LEVELS.index(self.level)):
            return False
        return at >= self.since and (self.grep is None or self.grep.search(text) is not None)


def add_filters(to: argparse.ArgumentParser) -> None:
    level = to.add_argument(
        "--level",
        type=_level,
        metavar="LEVEL",
        help=f"only log records of this level or above: {', '.join(LEVELS)}; leaves out what was printed",
    )
    completed(level, dict.fromkeys(LEVELS, ""))
    to.add_argument("--since", type=_ago, metavar="TIME", help="only lines since then: 30 (seconds ago), 10m, 2h or 1d")
    to.add_argument(
        "--grep", type=_pattern, metavar="REGEX", help="only lines whose text contains a regular expression"
    )


def wanted(options: argparse.Namespace) -> Wanted:
    since = 0.0 if options.since is None else time.time() - options.since
    return Wanted(options.level or "", since, options.grep)


def _level(text: str) -> str:
    if text.lower() not in LEVELS:
        raise argparse.ArgumentTypeError(f"`{text}` is no level; there are: {', '.join(LEVELS)}")
    return text.lower()


def _ago(text: str) -> float:
    found = _AGO.fullmatch(text)
    seconds = float(found[1]) * _UNITS[found[2] or "s"] if found else math.inf
    if not math.isfinite(seconds):
        raise argparse.ArgumentTypeError(f"`{text}` is no time such as 30s, 10m, 2h or 1d")
    return seconds


def _pattern(text: str) -> re.Pattern[str]:
    try:
        return re.compile(text)
    except (re.error, OverflowError, RecursionError) as exc:
        raise argparse.ArgumentTypeError(f"`{text}` is no regular expression: {exc}") from exc
