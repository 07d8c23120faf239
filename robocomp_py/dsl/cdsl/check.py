"""Model to diagnostics: what is wrong with a component, given the interfaces it can use."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from ...contract.interface import Interface
from ..diagnostics import Report, did_you_mean
from ..source import Name
from . import model as m
from .qos import read_qos

OPTIONS = ("dsr", "agmagent", "innermodelviewer")
"""Options that RoboComp's generators know; none of them has an effect here."""

Interfaces = Mapping[str, Sequence[Interface]]
"""What the imports (and theirs) define, by unqualified name."""


def check(model: m.Component, interfaces: Interfaces, importable: Sequence[str], report: Report) -> None:
    """`importable` are the names of the IDSL files that could be imported, without their ending."""
    for item in model.items:
        _check_item(item, model, interfaces, importable, report)
    if model.language is None:
        _warn_language(model, report)
    elif "python" not in model.language.text.lower():
        report.warning(
            "not-python",
            f"`language {model.language}`: a Python component is generated all the same",
            model.language.span,
            "write `language python;`",
        )
    for option in model.options:
        known = option.text.lower() in OPTIONS
        message = f"option `{option}` has no effect here" if known else f"unknown option `{option}`"
        report.warning("ineffective-option" if known else "unknown-option", message, option.span)
    if model.gui:
        report.warning("ineffective-gui", "a `gui` has no effect yet", model.gui.span)
    if model.statemachine:
        report.warning("ineffective-statemachine", "a `statemachine` has no effect yet", model.statemachine.span)
    for legacy in model.legacy:
        report.warning(
            "legacy-clause", f"`{legacy.word}` is from an older RoboComp and has no effect", legacy.span, "remove it"
        )
    if model.period is not None and model.period_span and not model.period > 0:
        report.error("bad-period", "a period is longer than nothing", model.period_span)


def _check_item(
    item: m.Item, model: m.Component, interfaces: Interfaces, importable: Sequence[str], report: Report
) -> None:
    found = interfaces.get(item.interface.text, ())
    if not found:
        _report_unknown(item.interface, model, interfaces, importable, report)
        return
    if len(found) > 1:
        names = " and ".join(each.name for each in found)
        report.error(
            "ambiguous-interface", f"`{item.interface}` is {names}", item.interface.span, "import one of them only"
        )
    interface = found[0]
    if not interface.operations:
        report.warning("empty-interface", f"`{item.interface}` has no operations", item.interface.span)
    else:
        _check_verb(item, interface, report)
    if item.qos and not item.verb.is_topic:
        report.error("qos-of-calls", "only what is published or subscribed to has a QoS", item.qos[0].name.span)
    elif item.qos:
        read_qos(item.qos, report)
    if item.concurrent and item.verb.has_proxy:
        report.error(
            "concurrent-proxy", "only what is implemented or subscribed to can be concurrent", item.interface.span
        )
    if item.marker and item.marker.text.lower() in ("ice", "ros"):
        report.warning(
            "unknown-middleware",
            f"middleware `{item.marker}` does not exist yet; the component's own is used",
            item.marker.span,
        )


def _check_verb(item: m.Item, interface: Interface, report: Report) -> None:
    left_out = [operation for operation in interface.operations if not operation.carried(item.verb)]
    twoway = [f"`{operation.name}`" for operation in left_out if operation.pattern is None]
    if twoway:
        message = f"{', '.join(twoway)} cannot be published: a publication gives nothing back"
        report.warning("not-a-publication", message, item.interface.span, f"`{item.verb}` leaves it out")
    elif len(left_out) == len(interface.operations):
        report.error(
            "wrong-verb",
            f"no operation of `{item.interface}` takes part in `{item.verb}`",
            item.interface.span,
            "it has no publications" if item.verb.is_topic else "it has publications only",
        )


def _report_unknown(
    name: Name, model: m.Component, interfaces: Interfaces, importable: Sequence[str], report: Report
) -> None:
    if name.text in model.skipped:
        return
    if name.text in importable:
        hint = f'add: import "{name}.idsl";'
        report.error("missing-import", f"interface `{name}` is not imported", name.span, hint)
        return
    hint = did_you_mean(name.text, interfaces) or did_you_mean(name.text, importable)
    report.error("unknown-interface", f"unknown interface `{name}`", name.span, hint)


def _warn_language(model: m.Component, report: Report) -> None:
    if not re.search(r"\blanguage\b", model.skipped, re.IGNORECASE):
        report.warning("no-language", "no language is given", model.name.span, "write `language python;`")
