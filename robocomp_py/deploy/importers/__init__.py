"""Deployments of RoboComp's other tools, read and written as DDSL.

rcmanager.py   rcmanager's XML     → programs
subtoml.py     sub.toml            → programs
finding.py     programs            → the components whose .cdsl is on this machine
ddsl.py        both                → the text of a DDSL file
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ...dsl.diagnostics import Report
from ...dsl.source import Source
from .ddsl import to_ddsl
from .finding import Finder
from .programs import Listing
from .rcmanager import read_rcmanager
from .subtoml import read_subtoml

FORMATS: dict[str, Callable[[Source, Report], Listing | None]] = {".xml": read_rcmanager, ".toml": read_subtoml}


def import_deployment(source: Source, finder: Finder, folder: Path, report: Report) -> str | None:
    """The text of a DDSL file in that folder; None if the source cannot be read, which is reported."""
    listing = FORMATS[source.path.suffix.lower()](source, report)
    return to_ddsl(listing, finder, folder) if listing else None
