"""The commands, arguments and environments of programs. No shell reads them."""

from __future__ import annotations

import re
import shlex
from collections.abc import Sequence, Set

from ..diagnostics import Report
from . import model as m


def check_programs(model: m.Deployment, report: Report) -> None:
    for instance in model.instances:
        _check_program(instance, report)
        _check_notifies(instance, model.skipped, report)


def environment_of(model: m.Deployment, together: Sequence[m.Instance]) -> dict[str, str]:
    """The environment that the network gives to a process."""
    return {variable.name.text: variable.value.text for each in together for variable in each.env}


def notifies_of(model: m.Deployment, together: Sequence[m.Instance]) -> bool:
    """Whether a process reports that it is ready, as all components do."""
    return together[-1].program is None or together[-1].notifies is not None


def _check_program(instance: m.Instance, report: Report) -> None:
    _check_variables(instance, report)
    given = (*instance.args, *(each.value for each in instance.env), instance.path, instance.config, instance.existing)
    for text in given:
        if text and "\0" in text.text:
            message = "a text with a null character cannot be passed to a program"
            report.error("bad-command", message, text.span, "remove the null character")
    command = instance.existing
    if command is None:
        return
    if instance.path:
        message = "`existing` and `path` both say what is run"
        related = "the path is here", instance.path.span
        report.error("duplicate", message, command.span, "remove one of them", related)
    try:
        words = shlex.split(command.text)
    except ValueError as exc:
        message = f"`{command}` cannot be split into words: {str(exc).lower()}"
        report.error("bad-command", message, command.span, "put a word with spaces into single quotes")
        return
    if not words:
        report.error("bad-command", "there is no command", command.span, 'as in: existing "urg_node --frame base";')
    elif found := _shell_syntax(command.text):
        message = f"`{found}` is shell syntax, but no shell reads this: the program would get it as an argument"
        hint = "put it into single quotes if you mean that; otherwise write a script and name it here"
        report.error("bad-command", message, command.span, hint)


def _check_notifies(instance: m.Instance, skipped: Set[str], report: Report) -> None:
    """Check that only programs have `notifies`. `skipped`: words that syntax errors left out."""
    if instance.notifies and not instance.program and not skipped & {"path", "existing"}:
        message = f"`{instance.name}` is a generated component, which reports by itself when it is ready"
        hint = "remove it, or name the program by `path` or `existing`"
        report.error("not-a-program", message, instance.notifies.span, hint)


def _shell_syntax(command: str) -> str:
    """The first text outside quotes that only a shell would understand; "" if there is none."""
    found = _FOR_SHELLS.search(_QUOTED.sub("_", command))
    return found[0] if found else ""


_QUOTED = re.compile(r"'[^']*'|\\.")
_FOR_SHELLS = re.compile(r"[|&;<>()]+|`|\*|\?|\$[\w{(]\w*|(?<!\S)~")


def _check_variables(instance: m.Instance, report: Report) -> None:
    seen: dict[str, m.Variable] = {}
    for each in instance.env:
        first = seen.setdefault(each.name.text, each)
        if first is not each:
            message = f"the variable `{each.name}` is given twice"
            report.error("duplicate", message, each.span, "", ("first here", first.span))
