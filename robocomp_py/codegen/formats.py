"""Exports interfaces to foreign formats, each of which a plug-in writes."""

from __future__ import annotations

from .. import plugins
from ..dsl.diagnostics import Report
from .exporting import Files
from .generate import Artifact, GenerationError


def export(files: Files, to: str, report: Report) -> tuple[Artifact, ...]:
    """The files of that format. If the report has errors, because the format cannot express something, do not use them.

    Raises GenerationError if the files clash, ConfigurationError if no plug-in writes the format.
    """
    if files.clash:
        raise GenerationError(f"{files.clash}; give them to rcgen one by one")
    artifacts = plugins.exporter(to)(files, report)
    paths = [each.path for each in artifacts]
    twice = next((path for path in paths if paths.count(path) > 1), None)
    if twice and not report.errors:
        raise GenerationError(f"two files would become {twice}; give them to rcgen one by one")
    return artifacts
