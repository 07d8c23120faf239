"""Paths to checked, linked models. Imports are found along one documented path, and read once.

Where an import is looked for, in this order:

    the folder of the importing file · -I folders · $ROBOCOMP_INTERFACES (a path list)
    $ROBOCOMP/interfaces/IDSLs · ~/robocomp/interfaces/IDSLs · /opt/robocomp/interfaces/IDSLs
    the interfaces shipped with robocomp_py

An import may be a file name, with or without its ending, a relative path, or an absolute path of
another machine; if there is no such file, its last part is looked for.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path, PurePosixPath

from ..contract.component import Component
from ..contract.interface import Interface
from ..contract.module import Module
from ..contract.parameters import ParameterSet
from .cdsl.check import Interfaces
from .cdsl.check import check as check_cdsl
from .cdsl.link import link as link_cdsl
from .cdsl.model import Component as CdslComponent
from .cdsl.parser import parse as parse_cdsl
from .ddsl.model import Deployment
from .ddsl.parser import parse as parse_ddsl
from .diagnostics import Report, did_you_mean
from .idsl.check import check as check_idsl
from .idsl.check import qualified
from .idsl.link import link as link_idsl
from .idsl.model import File as IdslFile
from .idsl.parser import parse as parse_idsl
from .pdsl.check import check as check_pdsl
from .pdsl.link import link as link_pdsl
from .pdsl.parser import parse as parse_pdsl
from .source import Name, Source

ENDINGS = (".idsl", ".cdsl", ".pdsl", ".ddsl")
SHIPPED = Path(str(files("robocomp_py") / "interfaces"))

Read = Callable[[Path], bytes]


@dataclass(frozen=True)
class LinkedComponent:
    """What a CDSL file comes to: the component, and the modules its interfaces need."""

    path: Path
    component: Component
    modules: tuple[Module, ...]
    params: str = ""
    """The name of its PDSL file, if it has one."""


@dataclass(eq=False)
class _Idsl:
    """An IDSL file and what it imports. Without a module if it, or something it needs, is wrong."""

    file: IdslFile
    imports: list[_Idsl] = field(default_factory=list)
    module: Module | None = None


class Workspace:
    """Reads files of all the languages; everything wrong with them is in `report`.

    `read` returns a file's bytes and raises OSError: the disk's by default, an editor's buffers or
    a test's dict otherwise.
    """

    def __init__(self, include: Sequence[Path] = (), read: Read = Path.read_bytes) -> None:
        self.report = Report()
        self._include = [Path(folder) for folder in include]
        self._read = read
        self._sources: dict[Path, Source | None] = {}
        self._idsl: dict[Path, _Idsl | None] = {}
        self._reading: list[Path] = []

    # One file of each language. None means: too wrong to go on; the report says why.

    def check(self, path: Path) -> None:
        """Parse and check a file of any of the languages, and what it imports."""
        match path.suffix.lower():
            case ".idsl":
                self.interfaces(path)
            case ".cdsl":
                self.component(path)
            case ".pdsl":
                self.parameters(path)
            case ".ddsl":
                self.deployment(path)
            case _:
                at = Source(path, "").span(0, 0)
                self.report.error("unknown-language", f"no language has this ending; known: {', '.join(ENDINGS)}", at)

    def interfaces(self, path: Path) -> Module | None:
        """The module of an IDSL file."""
        found = self._load_idsl(path)
        return found.module if found else None

    def parameters(self, path: Path) -> ParameterSet | None:
        """The parameters of a PDSL file, those it imports included."""
        return self._load_pdsl(path, [])

    def component(self, path: Path) -> LinkedComponent | None:
        """The component of a CDSL file."""
        source = self.source(path)
        model = parse_cdsl(source, self.report) if source else None
        if source is None or model is None:
            return None
        roots = self._load_imports(model.imports, source)
        common = self._load_idsl(SHIPPED / "CommonBehavior.idsl")
        loaded = _closure([*roots, *([common] if common else [])])
        interfaces = _interfaces_in(loaded)
        complete = len(roots) == len(model.imports) and all(each.module for each in loaded)
        self._check_component(model, interfaces, complete)
        params = self._params_of(model)
        if not complete or self._errors_in(source) or (model.params and params is None):
            return None
        component = link_cdsl(model, interfaces, params)
        used = any(port.interface.module == "RoboCompCommonBehavior" for port in component.ports)
        pdsl = PurePosixPath(model.params.text).name if model.params else ""
        return LinkedComponent(path, component, _merged(loaded if used else _closure(roots)), pdsl)

    def components_of(self, path: Path) -> list[Path]:
        """The CDSL files that a DDSL file imports."""
        model = self.deployment(path)
        return self.components_of_model(model) if model else []

    def components_of_model(self, model: Deployment) -> list[Path]:
        """The CDSL files that a deployment imports."""
        found = [self._resolve(name, model.source, ".cdsl") for name in model.imports]
        return [each for each in found if each]

    def deployment(self, path: Path) -> Deployment | None:
        """The model of a DDSL file. What its network comes to is `robocomp_py.deploy.plan`'s to say."""
        source = self.source(path)
        return parse_ddsl(source, self.report) if source else None

    # Finding and reading.

    def search_path(self, importing: Path) -> list[Path]:
        """The folders in which the imports of a file are looked for, in order."""
        environment = os.environ
        listed = [Path(each) for each in environment.get("ROBOCOMP_INTERFACES", "").split(os.pathsep) if each]
        robocomp = environment.get("ROBOCOMP")
        homes = [Path(robocomp)] if robocomp else []
        homes += [Path.home() / "robocomp", Path("/opt/robocomp")]
        standard = [home / "interfaces" / "IDSLs" for home in homes]
        return list(dict.fromkeys([importing.parent, *self._include, *listed, *standard, SHIPPED]))

    def find(self, name: str, importing: Path, ending: str) -> Path | None:
        """The file an import means."""
        folders = self.search_path(importing)
        for form in _forms(name, ending):
            for folder in folders:
                if self._exists(folder / form):
                    return folder / form
        return None

    def source(self, path: Path) -> Source | None:
        """A file's text, read once."""
        if path not in self._sources:
            self._sources[path] = self._decode(path)
        return self._sources[path]

    def _decode(self, path: Path) -> Source | None:
        try:
            data = self._read(path)
        except OSError as exc:
            self.report.error("unreadable", f"cannot be read: {exc.strerror or exc}", Source(path, "").span(0, 0))
            return None
        try:
            return Source(path, data.decode("utf-8-sig"))
        except UnicodeDecodeError as exc:
            source = Source(path, data.decode("latin-1"))
            self.report.warning("not-utf8", "this is not UTF-8; read as Latin-1", source.span(exc.start, exc.start + 1))
            return source

    def _exists(self, path: Path) -> bool:
        if self._read is Path.read_bytes:
            return path.is_file()
        try:
            self._read(path)
        except OSError:
            return False
        return True

    def _resolve(self, name: Name, importing: Source, ending: str) -> Path | None:
        found = self.find(name.text, importing.path, ending)
        if found is None:
            folders = self.search_path(importing.path)
            near = {file.stem for folder in folders for file in folder.glob(f"*{ending}")}
            hint = did_you_mean(PurePosixPath(name.text).stem, near) or "add its folder by -I or ROBOCOMP_INTERFACES"
            self.report.error(
                "missing-import",
                f"`{name}` was not found in {', '.join(map(str, folders))}",
                name.span,
                hint,
            )
        return found

    # IDSL.

    def _load_imports(self, imports: Sequence[Name], importing: Source) -> list[_Idsl]:
        found = []
        for name in imports:
            path = self._resolve(name, importing, ".idsl")
            if path is None:
                continue
            if path.resolve() in self._reading:
                self.report.error("import-cycle", f"`{name}` imports this file, however indirectly", name.span)
                continue
            loaded = self._load_idsl(path)
            if loaded:
                found.append(loaded)
        return found

    def _load_idsl(self, path: Path) -> _Idsl | None:
        key = path.resolve()
        if key not in self._idsl:
            self._reading.append(key)
            self._idsl[key] = self._read_idsl(path)
            self._reading.pop()
        return self._idsl[key]

    def _read_idsl(self, path: Path) -> _Idsl | None:
        source = self.source(path)
        file = parse_idsl(source, self.report) if source else None
        if source is None or file is None:
            return None
        loaded = _Idsl(file, self._load_imports(file.imports, source))
        if len(loaded.imports) < len(file.imports):
            return loaded  # names of what is missing would only seem to be wrong
        others = _closure(loaded.imports)
        scope = {qualified(d.name.text, each.file.module.text): d for each in others for d in each.file.definitions}
        check_idsl(file, scope, self.report)
        if not self._errors_in(source) and all(each.module for each in others):
            known = {d.name: d for each in others if each.module for d in each.module.definitions}
            loaded.module = link_idsl(file, known)
        return loaded

    # PDSL.

    def _params_of(self, model: CdslComponent) -> ParameterSet | None:
        if model.params is None:
            return None
        path = model.source.path.parent / model.params.text
        if not self._exists(path):
            self.report.error("missing-file", f"there is no file {path}", model.params.span)
            return None
        return self.parameters(path)

    def _load_pdsl(self, path: Path, reading: list[Path]) -> ParameterSet | None:
        source = self.source(path)
        file = parse_pdsl(source, self.report) if source else None
        if source is None or file is None:
            return None
        check_pdsl(file, self.report)
        parts = []
        for name in file.imports:
            found = self._resolve(name, source, ".pdsl")
            if found and found.resolve() in (path.resolve(), *reading):
                self.report.error("import-cycle", f"`{name}` imports this file, however indirectly", name.span)
            elif found and (part := self._load_pdsl(found, [*reading, path.resolve()])):
                parts.append(part)
        if self._errors_in(source):
            return None
        own = link_pdsl(file)
        return ParameterSet(
            own.name,
            tuple(p for part in (*parts, own) for p in part.parameters),
            tuple(each for part in (*parts, own) for each in part.lists),
        )

    def _check_component(self, model: CdslComponent, interfaces: Interfaces, complete: bool) -> None:
        found = Report()
        importable = [f.stem for each in self.search_path(model.source.path) for f in sorted(each.glob("*.idsl"))]
        check_cdsl(model, interfaces, importable, found)
        follow_ups = () if complete else ("unknown-interface", "missing-import")
        self.report.extend(each for each in found.diagnostics if each.code not in follow_ups)

    def _errors_in(self, source: Source) -> bool:
        return any(each.span.source is source for each in self.report.errors)


def _forms(name: str, ending: str) -> Iterator[PurePosixPath]:
    """The spellings under which an imported file may be found, the exact one first."""
    given = PurePosixPath(name.replace("\\", "/"))
    for path in dict.fromkeys((given, PurePosixPath(given.name))):
        yield path
        if path.suffix.lower() != ending:
            yield path.with_name(path.name + ending)


def _closure(roots: Sequence[_Idsl]) -> list[_Idsl]:
    """These files and all they import, each once, after those it imports."""
    found: dict[_Idsl, None] = {}

    def visit(each: _Idsl) -> None:
        if each not in found:
            for imported in each.imports:
                visit(imported)
            found[each] = None

    for root in roots:
        visit(root)
    return list(found)


def _interfaces_in(loaded: Sequence[_Idsl]) -> dict[str, list[Interface]]:
    found: dict[str, list[Interface]] = {}
    for each in loaded:
        for definition in each.module.definitions if each.module else ():
            if isinstance(definition, Interface):
                found.setdefault(definition.short, []).append(definition)
    return found


def _merged(loaded: Sequence[_Idsl]) -> tuple[Module, ...]:
    """The modules of these files; files that share a module become one."""
    merged: dict[str, Module] = {}
    for module in (each.module for each in loaded if each.module):
        before = merged.get(module.name, Module(module.name, ()))
        merged[module.name] = Module(
            module.name, (*before.definitions, *module.definitions), (*before.files, *module.files)
        )
    return tuple(merged.values())
