"""Interfaces in the languages of others, each written by a plug-in."""

from __future__ import annotations

from .. import plugins
from ..dsl.diagnostics import Report
from .exporting import Files
from .generate import Artifact, GenerationError


def export(files: Files, to: str, report: Report) -> tuple[Artifact, ...]:
    """The files of that format; what it cannot hold is reported, and then they are not to be used.

    Raises GenerationError if the files do not fit together, ConfigurationError if nothing writes the format.
    """
    if files.clash:
        raise GenerationError(f"{files.clash}; give them to rcgen one by one")
    artifacts = plugins.exporter(to)(files, report)
    paths = [each.path for each in artifacts]
    twice = next((path for path in paths if paths.count(path) > 1), None)
    if twice and not report.errors:
        raise GenerationError(f"two files would become {twice}; give them to rcgen one by one")
    return artifacts
