"""`rcdeploy --import`: networks of other tools, written as DDSL."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path

from ...errors import ConfigurationError
from ..common import FINE, WRONG, complain, show


def import_network(path: Path, output: Path | None) -> int:
    """Write a network as DDSL. An existing file is never overwritten, because it may have been edited."""
    from ... import plugins
    from ...dsl.workspace import Workspace

    try:
        importer = plugins.network_importer(path)
    except ConfigurationError as exc:
        return complain(f"rcdeploy: --import {exc}")
    if output and output.suffix.lower() != ".ddsl":
        return complain(f"rcdeploy: -o {output}: a network is a .ddsl file")
    workspace = Workspace()
    source = workspace.source(path)
    folder = output.parent if output else Path.cwd()
    text = importer.to_ddsl(source, folder, workspace.report) if source else None
    show(workspace.report.diagnostics)
    if text is None:
        return WRONG
    if output is None:
        print(text, end="")
        return FINE
    try:
        _write_new(output, text)
    except FileExistsError:
        return complain(f"rcdeploy: {output} exists and was not changed; give another name, or move the file away")
    except OSError as exc:
        return complain(f"rcdeploy: {output} cannot be written: {exc.strerror}")
    print(f"{output} is written; read its comments, then: rc lint {shlex.quote(str(output))}", file=sys.stderr)
    return FINE


def _write_new(path: Path, text: str) -> None:
    """Write a new file completely or not at all: a partial file would block the next try."""
    with path.open("x", encoding="utf-8") as file:
        try:
            file.write(text)
            file.flush()
        except BaseException:
            path.unlink()
            raise
