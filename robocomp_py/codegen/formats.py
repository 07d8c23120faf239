"""The languages of others that interfaces can be written in."""

from __future__ import annotations

from ..dsl.diagnostics import Report
from .exporting import Files
from .generate import Artifact, GenerationError
from .omgexport import to_omgidl
from .rosmsg import to_rosmsg
from .slice import to_slice

FORMATS = ("slice", "omgidl", "rosmsg")


def export(files: Files, to: str, report: Report, *, underscore: bool = False) -> tuple[Artifact, ...]:
    """The files of that format; what it cannot hold is reported, and then they are not to be used.

    Raises GenerationError if the files do not fit together.
    """
    if files.clash:
        raise GenerationError(f"{files.clash}; give them to rcgen one by one")
    match to:
        case "slice":
            artifacts = to_slice(files, report, underscore=underscore)
        case "omgidl":
            artifacts = to_omgidl(files, report)
        case _:
            artifacts = to_rosmsg(files, report)
    paths = [each.path for each in artifacts]
    twice = next((path for path in paths if paths.count(path) > 1), None)
    if twice and not report.errors:
        raise GenerationError(f"two files would become {twice}; give them to rcgen one by one")
    return artifacts
