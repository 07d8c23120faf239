"""A configuration file checked against models, with the places in its text.

What is wrong is found by what a component checks itself with when it starts.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from .. import installed
from ..contract.component import Component
from ..contract.middleware import generated_for
from ..contract.parameters import Complaint
from ..dsl.diagnostics import Diagnostic
from ..dsl.source import Source, Span
from ..dsl.workspace import ENDINGS, Workspace
from ..errors import ConfigurationError
from ..plugins import worker_loader
from ..runtime import settings
from ..runtime.document import Document, NotToml
from ..runtime.settings import Settings
from ..spelling import unknown
from .mending import Mended, mend


def is_configuration(path: Path) -> bool:
    """Whether a file is a configuration, by its name or folder: `config.toml`, `config.debug`, `etc/generic_config`."""
    is_ours = path.suffix.lower() in (*ENDINGS, ".scxml")
    is_config = path.name.lower().startswith("config") or (path.parent.name == "etc" and "config" in path.name.lower())
    return path.suffix.lower() == ".toml" or (is_config and not is_ours)


def check_configuration(path: Path, workspace: Workspace, against: Path | None = None) -> None:
    """Report what is wrong with a configuration for a component (.cdsl) or for parameters (.pdsl).

    Without them, it is for the component beside it, or beside the folder it is in.
    """
    source = workspace.source(path)
    model = against or model_beside(path)
    if source is None:
        return
    if model is None:
        message = "the component of this configuration is unknown; give its .cdsl or .pdsl by --against"
        workspace.report.error("config-without-model", message, source.span(0, 0))
        return
    component = _component(model, workspace)
    if component:
        known = model.suffix.lower() != ".pdsl"
        check_text(source, component, workspace, model.parent, ports=known)


def model_beside(path: Path) -> Path | None:
    """The only component in the folder of a configuration, or in the one around that."""
    for folder in (path.absolute().parent, path.absolute().parent.parent):
        found = list(folder.glob("*.cdsl"))
        if found:
            return found[0] if len(found) == 1 else None
    return None


def _component(model: Path, workspace: Workspace) -> Component | None:
    if model.suffix.lower() != ".pdsl":
        linked = workspace.component(model)
        return linked.component if linked else None
    params = workspace.parameters(model)
    return Component(params.name, (), params) if params else None


def check_text(source: Source, component: Component, workspace: Workspace, folder: Path, *, ports: bool = True) -> None:
    """Report what is wrong with a configuration for the component of a folder; not its ports, if they are unknown."""
    report = workspace.report
    about = component.params, component.topics
    try:
        document, mended = settings.from_text(source.text, source.path, *about), Mended(source.text)
    except NotToml:
        mended = mend(source.text, source.path)
        report.extend(_not_toml(source, each) for each in mended.errors)
        if mended.is_wrong or mended.lacks_header:
            return
        document = settings.from_text(mended.text, source.path, *about)
    except ConfigurationError as exc:  # another form, which no installed package reads
        report.error("config-syntax", str(exc).removeprefix(f"{source.path}: "), source.span(0, 0))
        return
    document.passed_on = component.params is None and worker_loader(folder) is not None
    settings.settle(document, component, generated_for(folder) if ports else "")
    checked, complaints = settings.examine(component, document)
    complaints = [each for each in complaints if not _may_be_left_out(each, mended)]
    for each in [*complaints, *_unknown_middlewares(checked)]:
        if ports or each.key[:1] != ("ports",):
            report.extend([Diagnostic(each.code, each.message, span_of(source, document, each))])
    for renamed in document.renamed:
        spot = document.spot(renamed.key)
        report.warning("config-renamed-key", renamed.message, source.span(*spot.key) if spot else source.span(0, 0))
    told = [span_of(source, document, each).start for each in complaints]
    for note in document.notes:
        span = source.span(note.spot.key[0], note.spot.value[1]) if note.spot else source.span(0, 0)
        if not note.understood and span.start not in told:
            report.warning("config-not-understood", note.why, span)
        elif note.understood and not note.became and not (note.undeclared and document.passed_on):
            report.warning("config-without-effect", f"`{note.key}` has no effect: it is {note.why}", span)


def _unknown_middlewares(checked: Settings) -> Iterator[Complaint]:
    known = installed.transports()
    for key, name in settings.middlewares(checked).items():
        if name not in known:
            yield Complaint(key, unknown("middleware", name, known), "config-unknown-value")


def _may_be_left_out(complaint: Complaint, mended: Mended) -> bool:
    """Whether something only seems to be missing, because its line is invalid TOML."""
    missing = complaint.code in ("config-missing", "config-item-count")
    return missing and any(mended.removed_name(part) for part in complaint.key)


def _not_toml(source: Source, error: NotToml) -> Diagnostic:
    """Invalid TOML, reported at the first invalid word or character, or at the last character."""
    start = max(0, min(error.offset, len(source.text) - 1))
    word = _WORD.match(source.text, start)
    span = source.span(start, word.end() if word else start + 1)
    return Diagnostic("config-syntax", error.reason, span, hint=error.hint)


_WORD = re.compile(r"\w+")


def span_of(source: Source, document: Document, complaint: Complaint) -> Span:
    """The value that is wrong, or the key, or the table in which something is missing."""
    spot = document.spot(complaint.key)
    if spot is None:
        return source.span(0, 0)
    is_key = document.says(complaint.key) and complaint.code in ("config-unknown-key", "config-item-count")
    return source.span(*(spot.key if is_key else spot.value))
