"""The plug-in for `rcdeploy --import`: converts networks of RoboComp's other tools to DDSL.

rcmanager.py   rcmanager's XML     → programs
finding.py     programs            → the components whose .cdsl is on this machine
ddsl.py        programs            → the text of a DDSL file
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from ...dsl.diagnostics import Report
from ...dsl.source import Source
from .ddsl import to_ddsl as written
from .finding import Finder
from .rcmanager import read_rcmanager

endings = {".xml": "rcmanager's XML"}


def to_ddsl(source: Source, folder: Path, report: Report, environment: Mapping[str, str] | None = None) -> str | None:
    """The text of a DDSL file in that folder; None if the source cannot be read, which is reported.

    `environment` replaces `os.environ`.
    """
    listing = read_rcmanager(source, report)
    return written(listing, Finder(source.path, environment), folder) if listing else None
