"""Four hooks for other packages, each an entry-point group; a plug-in is imported only when it is asked.

    [project.entry-points."robocomp_py.configurations"]    reads configuration files in another form
    [project.entry-points."robocomp_py.workers"]           runs components that are written for another framework
    [project.entry-points."robocomp_py.importers"]         turns the network of another tool into DDSL
    [project.entry-points."robocomp_py.exporters"]         writes interfaces in another language
    NAME = "MODULE"    or "MODULE:OBJECT": whatever has the functions of the protocol below

The first plug-in that accepts a file or folder has it; they are asked in the order of their names.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from . import installed
from .errors import ConfigurationError

if TYPE_CHECKING:
    from .codegen.exporting import Files
    from .codegen.generate import Artifact
    from .contract.component import Component
    from .contract.parameters import ParameterSet
    from .dsl.cdsl.model import Component as Model
    from .dsl.diagnostics import Diagnostic, Report
    from .dsl.source import Source
    from .runtime.document import Document
    from .runtime.worker import Worker

CONFIGURATIONS, WORKERS = "robocomp_py.configurations", "robocomp_py.workers"
IMPORTERS, EXPORTERS = "robocomp_py.importers", "robocomp_py.exporters"


class ConfigurationReader(Protocol):
    """Reads configuration files in another form than ours."""

    def find(self, folder: Path) -> Path | None:
        """The configuration of a component's folder, if it has one in this form that counts before ours."""

    def accepts(self, path: Path, text: str) -> bool:
        """Whether this is its form. It is asked only about texts that are not entirely in our own form."""

    def read(self, text: str, path: Path, params: ParameterSet, topics: Collection[str]) -> Document:
        """The same configuration in our keys.

        Notes of the document say what became of each line. `params` are the parameters that the component declares,
        `topics` the interfaces that it publishes or subscribes to. Raises ConfigurationError with the place.
        """


class WorkerLoader(Protocol):
    """Runs components whose specific part is not a `specificworker.py` of ours."""

    def accepts(self, folder: Path) -> bool:
        """Whether it runs the component in a folder."""

    def component(self, component: Component) -> Component:
        """A component, as its CDSL has it, in the meaning that the CDSL had in the other framework."""

    def load(self, folder: Path, package: str, *, alone: bool) -> type[Worker[Any]]:
        """Its worker class. `package` is the imported package for the folder, with `generic` below it.

        `alone` is whether no other component shares its process. Raises ComponentError if it cannot be run.
        """

    def adopted(
        self, component: Component, model: Model | None, found: Sequence[Diagnostic], folder: Path, middleware: str
    ) -> Adopted:
        """What `rcgen` tells of such a component, of which it writes the generic part only.

        `model` is what its CDSL file says, and `found` what was found in the files that were read.
        """


class Adopted(Protocol):
    """What a loader understands of one component."""

    def lines(self) -> Iterator[str]:
        """For people: what becomes of its files, and what was found in them."""

    def to_json(self) -> list[dict[str, Any]]:
        """For machines, a finding each."""


class NetworkImporter(Protocol):
    """Turns the network of another tool into DDSL."""

    endings: Mapping[str, str]
    """What its files are for people, by their ending: `{".xml": "rcmanager's XML"}`."""

    def to_ddsl(self, source: Source, folder: Path, report: Report) -> str | None:
        """The text of a DDSL file for that folder; None if the source cannot be read, which is reported."""


class InterfaceExporter(Protocol):
    """Writes interfaces in the language that its entry point is called after."""

    def __call__(self, files: Files, report: Report) -> tuple[Artifact, ...]:
        """The files. What the language cannot hold is reported; after an error, they are not used."""


def configuration_readers() -> Iterator[ConfigurationReader]:
    return _every(CONFIGURATIONS)


def worker_loader(folder: Path) -> WorkerLoader | None:
    """The loader that runs the component in a folder; None for a component of ours, or if there is no such loader.

    For a component of ours, no plug-in is imported.
    """
    if is_ours(folder):
        return None
    loaders: Iterator[WorkerLoader] = _every(WORKERS)
    return next((each for each in loaders if each.accepts(folder)), None)


def as_run(component: Component, folder: Path) -> Component:
    """A component as its CDSL in that folder means it."""
    loader = worker_loader(folder)
    return loader.component(component) if loader else component


def is_ours(folder: Path) -> bool:
    """Whether a component's specific part is written for this framework."""
    return (folder / "specificworker.py").exists()


def network_importer(path: Path) -> NetworkImporter:
    """The importer for a file, by its ending. Raises ConfigurationError."""
    importers: list[NetworkImporter] = list(_every(IMPORTERS))
    for each in importers:
        if path.suffix.lower() in each.endings:
            return each
    known = [f"{what} ({ending})" for each in importers for ending, what in each.endings.items()]
    raise ConfigurationError(f"{path}: no installed package imports this kind of file; known: {listed(known)}")


def exporters() -> list[str]:
    """The languages that interfaces can be written in."""
    return list(installed.entries(EXPORTERS))


def exporter(language: str) -> InterfaceExporter:
    """The writer of a language. Raises ConfigurationError."""
    found: InterfaceExporter = _plugin(EXPORTERS, language)
    return found


def listed(names: Sequence[str]) -> str:
    return ", ".join(names) or "none"


def _every(group: str) -> Iterator[Any]:
    with installed.asked_once():
        for name in installed.entries(group):
            yield _plugin(group, name)


def _plugin(group: str, name: str) -> Any:
    """A plug-in, imported. Raises ConfigurationError."""
    with installed.asked_once():
        known = installed.entries(group)
        if name not in known:
            raise ConfigurationError(f"no installed package has `{name}` for {group}; known: {listed(list(known))}")
        try:
            return installed.load(group, name)
        except ImportError as exc:
            raise ConfigurationError(f"`{name}` ({known[name].value}, for {group}) is not usable here: {exc}") from exc
