"""Model to diagnostics: values that make no sense, names used twice."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from ...contract.types import python_name
from ..diagnostics import Report, did_you_mean
from ..numbers import real, whole
from ..source import Name, Span
from . import model as m

_NUMERIC = ("int", "float", "double")
_INTEGER = re.compile(r"[+-]?(0[xX][0-9a-fA-F]+|\d+)")


def check(file: m.File, imported: Sequence[m.File], report: Report) -> None:
    """Report the errors in a file, given the files it imports directly or indirectly."""
    seen: dict[str, Name] = {}
    for other in imported:
        for name in _names(other.scope):
            seen.setdefault(name.text, name)
    _check_scope(file.scope, seen, report)


def _names(scope: m.Scope) -> list[Name]:
    return [*(param.name for param in scope.params), *(each.scope.name for each in scope.lists)]


def _check_scope(scope: m.Scope, seen: dict[str, Name], report: Report) -> None:
    for name in _names(scope):
        first = seen.setdefault(name.text, name)
        if first is not name:
            report.error("duplicate", f"`{name}` is defined twice", name.span, "", ("first here", first.span))
        if python_name(name.text) != name.text or name.text.startswith("__"):
            report.error("reserved-name", f"`{name}` is a keyword of Python", name.span, "give it another name")
    for param in scope.params:
        _check_param(param, report)
    for each in scope.lists:
        if each.items:
            _check_items(each.items, report)
        _check_scope(each.scope, {}, report)


def _check_items(items: tuple[Name, Name], report: Report) -> None:
    for bound in items:
        if not re.fullmatch(r"\d+", bound.text):
            report.error("bad-range", f"`{bound}` is not a number of items", bound.span)
            return
    low, high = items
    if whole(low.text) > whole(high.text):
        report.error("bad-range", f"{low} is more than {high}", low.span.to(high.span))
    elif whole(low.text) > m.MOST_ITEMS:
        report.error("bad-range", f"more than {m.MOST_ITEMS} items cannot be asked for", low.span)


def _check_param(param: m.Param, report: Report) -> None:
    if param.kind == "enum":
        _check_choices(param, report)
    elif param.kind in _NUMERIC:
        _check_numbers(param, report)


def _check_choices(param: m.Param, report: Report) -> None:
    seen: dict[str, Span] = {}
    for value in param.values:
        first = seen.setdefault(value.text, value.span)
        if first is not value.span:
            report.error("duplicate", f"`{value}` is defined twice", value.span, "", ("first here", first))
    if param.default.text not in seen:
        message = f"`{param.default}` is none of {', '.join(seen)}"
        report.error("bad-default", message, param.default.span, did_you_mean(param.default.text, seen))


def _check_numbers(param: m.Param, report: Report) -> None:
    for number in (param.default, *(param.range or ())):
        if param.kind == "int" and not _INTEGER.fullmatch(number.text):
            report.error("bad-default", f"`{number}` is not an integer", number.span)
            return
        if not math.isfinite(real(number.text)):
            report.error("bad-default", f"`{number}` is too large", number.span)
            return
    if not param.range:
        return
    low, high = param.range
    if real(low.text) > real(high.text):
        report.error("bad-range", f"{low} is more than {high}", low.span.to(high.span), "the smaller one comes first")
    elif not real(low.text) <= real(param.default.text) <= real(high.text):
        report.error("bad-default", f"{param.default} is not from {low} to {high}", param.default.span)
