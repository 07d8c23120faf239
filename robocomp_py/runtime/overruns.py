"""Warns when `compute` or a timer skips most of its periods."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import TYPE_CHECKING

from .hooks import name_of
from .timers import Timer

if TYPE_CHECKING:
    from .tally import Tallies

log = logging.getLogger("robocomp.worker")

_SLOW = 10
"""Number of skipped periods after which a component is reported as too slow."""


def warn_if_slow(timer: Timer, hook: Callable[[], object], took: float, tallies: Tallies) -> None:
    """Warn once if a timer has skipped more than half of its periods. A single late call is not reported.

    `took` are the seconds of the last call of its hook. `tallies` tell which handler may have kept it waiting.
    """
    if timer._was_slow or timer.overruns < max(_SLOW, timer.calls):
        return
    timer._was_slow = True
    if took >= timer.period:
        text = f"took {took:.3g} s, longer than the period of {timer.period:.3g} s: "
    else:
        text = f"waited for other code of this component{_slow_handler(timer.period, tallies)}: "
    log.warning("%s %s%d periods were skipped (more are only counted)", name_of(hook), text, timer.overruns)


def _slow_handler(period: float, tallies: Tallies) -> str:
    """For a message: the handler that took longest, if that was at least half of a period."""
    took, handler = tallies.slowest_handler()
    return f" ({handler} took {took:.3g} s, the period is {period:.3g} s)" if took >= period / 2 else ""
