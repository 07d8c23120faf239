"""Timers as expressions and methods of Python."""

from __future__ import annotations

from ..contract.component import PeriodicTimer
from .configuration import duration
from .layout import docstring, quoted


def timer_expression(timer: PeriodicTimer) -> str:
    return f"PeriodicTimer({quoted(timer.name)}, {timer.period})"


def timer_signature(timer: PeriodicTimer) -> str:
    return f"def {timer.method}(self) -> None:"


def timer_doc(timer: PeriodicTimer) -> str:
    return f"Called every {duration(timer.period)}."


def timer_method(timer: PeriodicTimer) -> str:
    """A new method of a timer, which does nothing."""
    lines = (timer_signature(timer), f"    {docstring(timer_doc(timer), 8)}")
    return "".join(f"    {line}\n" for line in lines)
