"""Finds, on this machine, the files and components that a file of another machine names."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from ...dsl.cdsl.model import Component
from ...dsl.cdsl.parser import parse
from ...dsl.diagnostics import Report
from ...dsl.workspace import Workspace


@dataclass(frozen=True)
class Found:
    """A component's folder and its .cdsl file."""

    cdsl: Path
    model: Component

    @property
    def name(self) -> str:
        return self.model.name.text

    @property
    def python(self) -> bool:
        """Whether it was generated as a component in Python."""
        return self.model.language is not None and "python" in self.model.language.text.lower()

    @property
    def folder(self) -> Path:
        return self.cdsl.parent


class Finder:
    """Finds components and files by the paths they had on the machine a deployment was written for.

    A path is tried unchanged; then with the reader's home in place of the original one; then relative to a folder in
    it that also contains the deployment. For /src/shelly/etc/deployment.xml, the path
    /home/robot/shelly/components/panel becomes /src/shelly/components/panel.
    """

    def __init__(self, importing: Path, environment: Mapping[str, str] | None = None) -> None:
        self._importing = importing.absolute()
        self._environment = os.environ if environment is None else environment

    def here(self, path: str) -> Path | None:
        """The file or folder of a path; None if it is not found."""
        return next((each for each in self._candidates(path) if each.exists()), None)

    def component(self, folder: str) -> Found | None:
        """The component that is started in this folder, or in its `bin` or `src`."""
        there = self.here(folder)
        if there is None or not there.is_dir():
            return None
        for each in (there, *([there.parent] if there.name in ("bin", "src", "etc", "build") else [])):
            for cdsl in sorted(each.glob("*.cdsl")):
                source = Workspace().source(cdsl)
                model = parse(source, Report()) if source else None
                if model:
                    return Found(cdsl, model)
        return None

    def expanded(self, path: str) -> Path:
        """The path with the reader's home for `~`."""
        return self._home / path[1:].lstrip("/") if path.startswith("~") else Path(path)

    @property
    def _home(self) -> Path:
        return Path(self._environment.get("HOME", "/"))

    def _candidates(self, text: str) -> Iterator[Path]:
        path = self.expanded(text)
        if not path.is_absolute():
            yield self._importing.parent / path
            return
        yield path
        parts = path.parts
        if parts[1:2] == ("home",) and len(parts) > 3:
            yield self._home.joinpath(*parts[3:])
        for folder in self._importing.parents:
            if folder.name in parts and folder.name:
                rest = parts[len(parts) - parts[::-1].index(folder.name) :]
                yield folder.joinpath(*rest)
