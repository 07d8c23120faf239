"""Model to diagnostics: values that make no sense, names used twice."""

from __future__ import annotations

import re

from ...contract.types import python_name
from ..diagnostics import Report
from ..source import Name
from . import model as m


def check(file: m.File, report: Report) -> None:
    _check_scope(file.scope, report)


def _check_scope(scope: m.Scope, report: Report) -> None:
    seen: dict[str, Name] = {}
    for name in (*(p.name for p in scope.params), *(each.scope.name for each in scope.lists)):
        first = seen.setdefault(name.text, name)
        if first is not name:
            report.error("duplicate", f"`{name}` is there twice", name.span, "", ("first here", first.span))
        if python_name(name.text) != name.text:
            report.error("reserved-name", f"`{name}` is a word of Python", name.span, "give it another name")
    for param in scope.params:
        _check_param(param, report)
    for each in scope.lists:
        if each.items:
            _check_items(each.items, report)
        _check_scope(each.scope, report)


def _check_items(items: tuple[Name, Name], report: Report) -> None:
    for bound in items:
        if not re.fullmatch(r"\d+", bound.text):
            report.error("bad-range", f"`{bound}` is no number of items", bound.span)
            return
    if int(items[0].text) > int(items[1].text):
        report.error("bad-range", f"{items[0]} is more than {items[1]}", items[0].span.to(items[1].span))


def _check_param(param: m.Param, report: Report) -> None:
    if param.kind == "enum":
        known = [value.text for value in param.values]
        if param.default.text not in known:
            report.error("bad-default", f"`{param.default}` is none of {', '.join(known)}", param.default.span)
        for index, value in enumerate(param.values):
            if value.text in known[:index]:
                report.error("duplicate", f"`{value}` is there twice", value.span)
        return
    if param.kind not in ("int", "float", "double"):
        return
    numbers = [param.default, *(param.range or ())]
    for number in numbers:
        if param.kind == "int" and not re.fullmatch(r"[+-]?\d+", number.text):
            report.error("bad-default", f"`{number}` is no integer", number.span)
            return
    if not param.range:
        return
    low, high = (float(bound.text.rstrip("fF")) for bound in param.range)
    if low > high:
        span = param.range[0].span.to(param.range[1].span)
        report.error("bad-range", f"{param.range[0]} is more than {param.range[1]}", span)
    elif not low <= float(param.default.text.rstrip("fF")) <= high:
        report.error(
            "bad-default", f"{param.default} is not from {param.range[0]} to {param.range[1]}", param.default.span
        )
