"""Paths to checked, linked models. Imports are found along one documented path, and read once.

An import is searched for in this order:

    the folder of the importing file · -I folders · $ROBOCOMP_INTERFACES (a path list)
    $ROBOCOMP/interfaces/IDSLs · ~/robocomp/interfaces/IDSLs · /opt/robocomp/interfaces/IDSLs
    the interfaces shipped with robocomp_py

An import may be a file name, a relative path, or an absolute path of another machine, each with or
without its extension. All folders are searched for the path as written; if no folder has such a file,
they are searched for its last part.
"""

from __future__ import annotations

import codecs
import os
import shlex
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from importlib.resources import files
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Generic, TypeVar

from .. import installed, plugins
from ..contract.component import Component
from ..contract.interface import Interface
from ..contract.module import Definition, Module
from ..contract.parameters import ParameterSet
from ..contract.statemachine import StateMachine
from ..garbage import no_collection
from .cdsl.check import Surroundings
from .cdsl.check import check as check_cdsl
from .cdsl.link import link as link_cdsl
from .cdsl.model import Component as CdslComponent
from .cdsl.model import Item
from .cdsl.parser import parse as parse_cdsl
from .diagnostics import Diagnostic, Report, did_you_mean, mistyped
from .idsl.check import check as check_idsl
from .idsl.check import qualified
from .idsl.link import link as link_idsl
from .idsl.model import File as IdslFile
from .idsl.parser import parse as parse_idsl
from .memory import Memory
from .nearby import nearby
from .pdsl.check import check as check_pdsl
from .pdsl.link import link as link_pdsl
from .pdsl.model import File as PdslFile
from .pdsl.parser import parse as parse_pdsl
from .source import Name, Source
from .syntax import MAX_CHARACTERS

if TYPE_CHECKING:
    from .ddsl.model import Deployment
    from .smdsl.model import File as SmdslFile

    Model = IdslFile | CdslComponent | PdslFile | Deployment | SmdslFile

ENDINGS = (".idsl", ".cdsl", ".pdsl", ".ddsl", ".smdsl")
"""The endings of our languages. A state machine may also be an SCXML file."""

_MODELS = (".ddsl", *ENDINGS)
"""The endings of a model that is called without one: a network has its folder's name more often than a component."""

_MISTAKES = (FileNotFoundError, IsADirectoryError)

SHIPPED = Path(str(files("robocomp_py") / "interfaces"))

COMMON_BEHAVIOR = "RoboCompCommonBehavior"
"""The module of the interface that every component has."""

MAX_BYTES = 4 * MAX_CHARACTERS
MAX_IMPORTS = 100
"""The longest chain of files that import one another."""

Read = Callable[[Path], bytes]


def read_file(path: Path) -> bytes:
    """A file's bytes; of a file that is too large, only enough to see that."""
    if path.is_fifo():
        raise OSError("it is a pipe, not a file")
    with path.open("rb") as file:
        return file.read(MAX_BYTES + 1)


@dataclass(frozen=True)
class LinkedComponent:
    """The result of a CDSL file: the component, and the modules its interfaces need."""

    path: Path
    component: Component
    modules: tuple[Module, ...]
    params: str = ""
    """The name of its PDSL file, if it has one."""
    statemachine: str = ""
    """The name of the file of its state machine, if it has one."""
    model: CdslComponent | None = field(default=None, compare=False, repr=False)
    """What the CDSL file says, with its places."""


F = TypeVar("F", IdslFile, PdslFile)
M = TypeVar("M")


@dataclass(eq=False)
class _Loaded(Generic[F]):
    """A file and what it imports. `module` is the result of an IDSL file, if all that it needs is valid."""

    file: F
    imports: list[_Loaded[F]] = field(default_factory=list)
    module: Module | None = None


class Workspace:
    """Reads files of all the languages; their errors are in `report`.

    `read` returns a file's bytes and raises OSError: the disk's by default, an editor's buffers or
    a test's dict otherwise. `middlewares` are those a component may ask for, by default the installed ones.
    With the `memory` of another workspace, files that did not change since are not parsed again.
    """

    def __init__(
        self,
        include: Sequence[Path] = (),
        read: Read = read_file,
        middlewares: Collection[str] | None = None,
        memory: Memory | None = None,
    ) -> None:
        self.report = Report()
        self._include = [Path(folder) for folder in include]
        self.read = read
        self._memory = memory or Memory()
        self._middlewares = list(installed.transports()) if middlewares is None else middlewares
        self._sources: dict[Path, Source | None] = {}
        self._idsl: dict[str, _Loaded[IdslFile] | None] = {}
        self._pdsl: dict[str, _Loaded[PdslFile] | None] = {}
        self._components: dict[str, LinkedComponent | None] = {}
        self._deployments: dict[str, Deployment | None] = {}
        self._machines: dict[str, StateMachine | None] = {}
        self._reading: list[str] = []

    # One file of each language. None means that it cannot be used; the report says why.

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
            case ".smdsl" | ".scxml":
                self.statemachine(path)
            case ".xml" if self._exists(path):
                from .innermodel.check import check as check_innermodel

                check_innermodel(path, self.read, self.report)
            case _ if not self._exists(path):
                self.source(path)  # reports it
            case _:
                at = Source(path, "", has_places=False).span(0, 0)
                message = f"no language has this file name extension; known: {', '.join(ENDINGS)}"
                is_configuration = path.suffix == ".toml" or path.parent.name == "etc"
                lint = f"check a configuration with: rc lint {shlex.quote(str(path))}" if is_configuration else ""
                self.report.error("unknown-language", message, at, did_you_mean(path.suffix, ENDINGS) or lint)

    def interfaces(self, path: Path) -> Module | None:
        """The module of an IDSL file."""
        found = self._load_idsl(path)
        return found.module if found else None

    def interface_files(self, path: Path) -> list[IdslFile]:
        """The models of an IDSL file and of all its imports, which come first; empty if there is any error."""
        found = self._load_idsl(path)
        return [each.file for each in _closure([found])] if found and found.module else []

    def parameters(self, path: Path) -> ParameterSet | None:
        """The parameters of a PDSL file, including imported ones."""
        found = self._load_pdsl(path)
        every = _closure([found] if found else [])
        if found is None or any(self._errors_in(each.file.source) for each in every):
            return None
        sets = [link_pdsl(each.file) for each in every]
        return ParameterSet(
            sets[-1].name,
            tuple(each for part in sets for each in part.parameters),
            tuple(each for part in sets for each in part.lists),
        )

    def component(self, path: Path) -> LinkedComponent | None:
        """The component of a CDSL file."""
        key = os.path.realpath(path)
        if key not in self._components:
            self._components[key] = self._link_component(path)
        return self._components[key]

    def components_of(self, path: Path) -> list[Path]:
        """The CDSL files that a DDSL file imports."""
        model = self.deployment(path)
        return self.components_of_model(model) if model else []

    def components_of_model(self, model: Deployment) -> list[Path]:
        """The CDSL files that a deployment imports."""
        found = [self._resolve(name, model.source, ".cdsl") for name in model.imports]
        return [each for each in found if each]

    def deployment(self, path: Path) -> Deployment | None:
        """The model of a DDSL file. `robocomp_py.deploy.planner` checks the resulting network."""
        key = os.path.realpath(path)
        if key not in self._deployments:
            from .ddsl.check import check as check_ddsl
            from .ddsl.parser import parse as parse_ddsl

            source = self.source(path)
            model = self._parsed(source, parse_ddsl) if source else None
            if model:
                check_ddsl(model, self.report)
            self._deployments[key] = model
        return self._deployments[key]

    def statemachine(self, path: Path) -> StateMachine | None:
        """The machine of an SMDSL or SCXML file."""
        key = os.path.realpath(path)
        if key not in self._machines:
            from .smdsl.check import check as check_smdsl
            from .smdsl.link import link as link_smdsl

            source = self.source(path)
            file = self._parsed(source, _machine_parser(path)) if source else None
            if file:
                check_smdsl(file, self.report)
            self._machines[key] = link_smdsl(file) if file and not self._errors_in(file.source) else None
        return self._machines[key]

    def model(self, path: Path) -> Model | None:
        """The unchecked model of a file of any of the languages; None if it cannot be read at all."""
        source = self.source(path)
        parse = _parser_of(path)
        if source is None or parse is None:
            return None
        return self._parsed(source, parse)

    # Finding and reading.

    def search_path(self, importing: Path) -> list[Path]:
        """The folders in which the imports of a file are searched for, in order."""
        environment = os.environ
        listed = [Path(each) for each in environment.get("ROBOCOMP_INTERFACES", "").split(os.pathsep) if each]
        robocomp = environment.get("ROBOCOMP")
        homes = [Path(robocomp)] if robocomp else []
        homes += [Path(os.path.expanduser("~/robocomp")), Path("/opt/robocomp")]
        standard = [home / "interfaces" / "IDSLs" for home in homes]
        return list(dict.fromkeys([importing.parent, *self._include, *listed, *standard, SHIPPED]))

    def find(self, name: str, importing: Path, ending: str) -> Path | None:
        """The file an import means."""
        folders = self.search_path(importing)
        candidates = (self._tidy(folder / form) for form in _forms(name, ending) for folder in folders)
        return next(filter(self._exists, candidates), None)

    def _tidy(self, path: Path) -> Path:
        """The short form of a path, `idsl/Arm.idsl` for `arm/../idsl/Arm.idsl`, if it is the same file."""
        if ".." not in path.parts:
            return path
        short = Path(os.path.normpath(path))
        return short if self._exists(short) and os.path.realpath(short) == os.path.realpath(path) else path

    def source(self, path: Path) -> Source | None:
        """A file's text, read once."""
        if path not in self._sources:
            self._sources[path] = self._decode(path)
        return self._sources[path]

    def _decode(self, path: Path) -> Source | None:
        try:
            data = self.read(path)
        except (OSError, ValueError) as exc:
            reason = getattr(exc, "strerror", None) or exc
            hint = nearby(path, str(path), taken=[str(path)], models=_MODELS) if isinstance(exc, _MISTAKES) else ""
            if isinstance(exc, IsADirectoryError):
                hint = hint or _in_folder(path)
            self.report.error(
                "unreadable", f"cannot be read: {reason}", Source(path, "", has_places=False).span(0, 0), hint
            )
            return None
        return self._memory.recall(path, data, lambda report: _decoded(path, data, report), self.report)

    def _parsed(self, source: Source, parse: Callable[[Source, Report], M]) -> M:
        return self._memory.recall((parse, source.path), source, lambda report: parse(source, report), self.report)

    def _exists(self, path: Path) -> bool:
        try:
            if self.read is read_file:
                return path.is_file()
            self.read(path)
        except (OSError, ValueError):  # a name that cannot be one, a folder that may not be entered
            return False
        return True

    def _resolve(self, name: Name, importing: Source, ending: str) -> Path | None:
        given = PurePosixPath(name.text).suffix.lower()
        if given in ENDINGS and given != ending:
            message = f"`{name}` is {_LANGUAGES[given]}; expected here: {_LANGUAGES[ending]}"
            self.report.error("wrong-import", message, name.span, _remedy(name.text, given, ending))
            return None
        found = self.find(name.text, importing.path, ending)
        if found is None:
            folders = self.search_path(importing.path)
            near = {file.stem for folder in folders for file in folder.glob(f"*{ending}")}
            meant, hint = mistyped(PurePosixPath(name.text).stem, near), "add its folder by -I or ROBOCOMP_INTERFACES"
            proposal = nearby(importing.path.parent / name.text, name.text) if "/" in name.text else ""
            proposal = proposal or (f"did you mean `{meant}`?" if meant else "")
            self.report.error(
                "missing-import",
                f"`{name}` was not found in {', '.join(map(str, folders))}",
                name.span,
                f"{proposal} else {hint}" if proposal else hint,
            )
        return found

    def _load_imports(
        self, imports: Sequence[Name], importing: Source, ending: str, load: Callable[[Path], _Loaded[F] | None]
    ) -> list[_Loaded[F]]:
        found = []
        for name in imports:
            path = self._resolve(name, importing, ending)
            if path is None:
                continue
            if os.path.realpath(path) in self._reading:
                self.report.error("import-cycle", f"`{name}` imports this file, directly or indirectly", name.span)
            elif len(self._reading) > MAX_IMPORTS:
                self.report.error("too-deep", f"more than {MAX_IMPORTS} files import one another", name.span)
            elif loaded := load(path):
                found.append(loaded)
        return found

    # IDSL.

    def _load_idsl(self, path: Path) -> _Loaded[IdslFile] | None:
        key = os.path.realpath(path)
        if key not in self._idsl:
            self._reading.append(key)
            with no_collection():
                self._idsl[key] = self._read_idsl(path)
            self._reading.pop()
        return self._idsl[key]

    def _read_idsl(self, path: Path) -> _Loaded[IdslFile] | None:
        source = self.source(path)
        file = self._parsed(source, parse_idsl) if source else None
        if source is None or file is None:
            return None
        loaded = _Loaded(file, self._load_imports(file.imports, source, ".idsl", self._load_idsl))
        others = _closure(loaded.imports)
        scope = {qualified(d.name.text, each.file.module.text): d for each in others for d in each.file.definitions}
        found = Report()
        check_idsl(file, scope, found, lambda stem: self.find(stem, path, ".idsl") is not None)
        complete = all(len(each.imports) == len(each.file.imports) for each in (loaded, *others))
        self.report.extend(each for each in found.diagnostics if complete or not _may_be_imported(each))
        if complete and not self._errors_in(source) and all(each.module for each in others):
            loaded.module = link_idsl(file, self._merge(others))
        return loaded

    def _merge(self, loaded: Sequence[_Loaded[IdslFile]]) -> dict[str, Definition]:
        """The definitions of these files, by qualified name. Two files may define a name only identically."""
        merged: dict[str, tuple[Definition, Name]] = {}
        found = Report()
        for each in loaded:
            names = {qualified(d.name.text, each.file.module.text): d.name for d in each.file.definitions}
            for definition in each.module.definitions if each.module else ():
                name = names.get(definition.name, each.file.module)  # the feedback of an action has no name of its own
                first, where = merged.setdefault(definition.name, (definition, name))
                if first != definition:
                    message = f"`{definition.name}` is defined differently in another imported file"
                    found.error("duplicate", message, name.span, "", ("first defined here", where.span))
        self.report.extend(found.diagnostics)
        return {name: definition for name, (definition, _) in merged.items()}

    # PDSL.

    def _params_of(self, model: CdslComponent) -> ParameterSet | None:
        if model.params is None:
            return None
        path = self._tidy(model.source.path.parent / model.params.text)
        if not self._exists(path):
            hint = nearby(path, model.params.text)
            self.report.error("missing-file", f"there is no file {path}", model.params.span, hint)
            return None
        return self.parameters(path)

    def _load_pdsl(self, path: Path) -> _Loaded[PdslFile] | None:
        key = os.path.realpath(path)
        if key not in self._pdsl:
            self._reading.append(key)
            self._pdsl[key] = self._read_pdsl(path)
            self._reading.pop()
        return self._pdsl[key]

    def _read_pdsl(self, path: Path) -> _Loaded[PdslFile] | None:
        source = self.source(path)
        file = self._parsed(source, parse_pdsl) if source else None
        if source is None or file is None:
            return None
        loaded = _Loaded(file, self._load_imports(file.imports, source, ".pdsl", self._load_pdsl))
        check_pdsl(file, [each.file for each in _closure(loaded.imports)], self.report)
        return loaded

    # SMDSL.

    def _machine_of(self, model: CdslComponent) -> StateMachine | None:
        if model.statemachine is None:
            return None
        path = self._tidy(model.source.path.parent / model.statemachine.text)
        if path.suffix.lower() not in _MACHINES:
            message = f"`{model.statemachine}` is not a state machine; its file must end in {' or '.join(_MACHINES)}"
            self.report.error("unknown-language", message, model.statemachine.span)
        elif self._exists(path):
            return self.statemachine(path)
        else:
            near = did_you_mean(path.name, [file.name for end in _MACHINES for file in path.parent.glob(f"*{end}")])
            self.report.error("missing-file", f"there is no file {path}", model.statemachine.span, near)
        return None

    # CDSL.

    def _link_component(self, path: Path) -> LinkedComponent | None:
        source = self.source(path)
        model = self._parsed(source, parse_cdsl) if source else None
        if source is None or model is None:
            return None
        roots = self._load_imports(model.imports, source, ".idsl", self._load_idsl)
        complete = len(roots) == len(model.imports)
        model = self._with_agent_ports(model, roots)
        roots += self._implied(model, roots)
        loaded = _closure([*roots, *self._common_behavior(roots)])
        complete = complete and all(each.module for each in loaded)
        definitions = self._merge(loaded)
        interfaces = _interfaces_in(definitions.values())
        params, machine = self._params_of(model), self._machine_of(model)
        suspects = _suspects(model.imports, loaded)
        self._check_component(model, interfaces, None if complete else suspects, machine)
        involved = [source, *(each.file.source for each in loaded)]
        if not complete or any(map(self._errors_in, involved)) or (model.params and params is None):
            return None
        if model.statemachine and machine is None:
            return None
        component = link_cdsl(model, interfaces, params, machine)
        used = any(port.interface.module == COMMON_BEHAVIOR for port in component.ports)
        pdsl, smdsl = (PurePosixPath(name.text).name if name else "" for name in (model.params, model.statemachine))
        modules = _modules(loaded if used else _closure(roots))
        return LinkedComponent(path, component, modules, pdsl, smdsl, model)

    def _with_agent_ports(self, model: CdslComponent, roots: Sequence[_Loaded[IdslFile]]) -> CdslComponent:
        """The component with the ports that `options agmagent` adds, as far as their interfaces are found."""
        option = model.agent
        if option is None:
            return model
        known = {each.name.text for file in _closure(roots) for each in file.file.definitions}
        added = tuple(
            Item(verb, Name(interface, option.span), option.span)
            for verb, interface in model.unnamed_agent_ports
            if interface in known or self.find(f"{interface}.idsl", model.source.path, ".idsl")
        )
        return replace(model, implied=added)

    def _implied(self, model: CdslComponent, roots: Sequence[_Loaded[IdslFile]]) -> list[_Loaded[IdslFile]]:
        """Interfaces that a component uses without an import."""
        found: list[_Loaded[IdslFile]] = []
        for name in model.implied_imports:
            known = {each.name.text for file in _closure([*roots, *found]) for each in file.file.definitions}
            wanted = {item.interface.text for item in model.ports} - known
            path = self.find(name, model.source.path, ".idsl") if wanted else None
            loaded = self._load_idsl(path) if path else None
            if loaded and any(each.name.text in wanted for each in loaded.file.definitions):
                found.append(loaded)
        return found

    def _common_behavior(self, roots: Sequence[_Loaded[IdslFile]]) -> list[_Loaded[IdslFile]]:
        """The interface that every component knows, unless the imports define one."""
        if any(each.file.module.text == COMMON_BEHAVIOR for each in _closure(roots)):
            return []
        common = self._load_idsl(SHIPPED / "CommonBehavior.idsl")
        return [common] if common else []

    def _check_component(
        self,
        model: CdslComponent,
        interfaces: dict[str, list[Interface]],
        suspects: Collection[str] | None,
        machine: StateMachine | None,
    ) -> None:
        """`suspects` are names that a failed import may define; None if all imports succeeded."""
        found = Report()
        importable: list[str] = []
        if any(item.interface.text not in interfaces for item in model.ports):
            imported = {PurePosixPath(name.text).stem for name in model.imports}
            files = (f for each in self.search_path(model.source.path) for f in sorted(each.glob("*.idsl")))
            importable = [file.stem for file in files if file.stem not in imported]
        surroundings = Surroundings(interfaces, importable, self._middlewares, machine, self._has_window(model))
        check_cdsl(model, surroundings, found)
        self.report.extend(e for e in found.diagnostics if suspects is None or not _is_follow_up(e, suspects))

    @staticmethod
    def _has_window(model: CdslComponent) -> bool:
        """Whether a `gui` has an effect: only for components that a plug-in runs."""
        return any(model.all("gui")) and plugins.worker_loader(model.source.path.parent) is not None

    def _errors_in(self, source: Source) -> bool:
        return any(each.span.source is source for each in self.report.errors)


_MACHINES = (".smdsl", ".scxml")


def _parser_of(path: Path) -> Callable[[Source, Report], Model | None] | None:
    """What parses a file with this ending."""
    match path.suffix.lower():
        case ".idsl":
            return parse_idsl
        case ".cdsl":
            return parse_cdsl
        case ".pdsl":
            return parse_pdsl
        case ".ddsl":
            from .ddsl.parser import parse

            return parse
        case ".smdsl" | ".scxml":
            return _machine_parser(path)
        case _:
            return None


def _machine_parser(path: Path) -> Callable[[Source, Report], SmdslFile | None]:
    if path.suffix.lower() == ".scxml":
        from .smdsl.scxml import parse as parse_scxml

        return parse_scxml
    from .smdsl.parser import parse

    return parse


def _in_folder(path: Path) -> str:
    """For a folder in place of a file: names one of its files."""
    found = sorted(each for each in path.iterdir() if each.suffix in _MODELS)
    return f"give a file, as `{found[0]}`" if found else "give a file"


def _decoded(path: Path, data: bytes, report: Report) -> Source | None:
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        at = Source(path, "").span(0, 0)
        report.error("not-utf8", "this is UTF-16", at, "save the file as UTF-8")
        return None
    try:
        return Source(path, data.decode("utf-8-sig"))
    except UnicodeDecodeError as exc:
        source = Source(path, data.decode("latin-1"))
        report.warning("not-utf8", "this is not UTF-8; read as Latin-1", source.span(exc.start, exc.start + 1))
        return source


_LANGUAGES = {
    ".idsl": "an IDSL file",
    ".cdsl": "a CDSL file",
    ".pdsl": "a PDSL file",
    ".ddsl": "a DDSL file",
    ".smdsl": "an SMDSL file",
}


def _remedy(name: str, given: str, ending: str) -> str:
    """What to do about an import of a file of another language."""
    match given, ending:
        case ".pdsl", ".idsl":
            return f'the parameters of a component are not imported: write params "{name}"; inside of it'
        case ".smdsl", ".idsl":
            return f'a state machine is not imported: write statemachine "{name}"; inside of the component'
        case ".cdsl", ".idsl":
            return "import the .idsl files of the interfaces that both use"
        case _, ".cdsl":
            return "import the .cdsl file of each component of the network"
        case _:
            return "remove it"


def _forms(name: str, ending: str) -> Iterator[PurePosixPath]:
    """The names under which an imported file may be found, the exact one first."""
    given = PurePosixPath(name.replace("\\", "/"))
    for path in dict.fromkeys((given, PurePosixPath(given.name))):
        if path.name:
            yield path
            if path.suffix.lower() != ending:
                yield path.with_name(path.name + ending)


def _closure(roots: Sequence[_Loaded[F]]) -> list[_Loaded[F]]:
    """These files and all their imports, each once and after its own imports."""
    found: dict[_Loaded[F], None] = {}

    def visit(each: _Loaded[F]) -> None:
        if each not in found:
            for imported in each.imports:
                visit(imported)
            found[each] = None

    for root in roots:
        visit(root)
    return list(found)


def _suspects(imports: Sequence[Name], loaded: Sequence[_Loaded[IdslFile]]) -> set[str]:
    """The names of interfaces that may seem to be missing only because a file was not found or has errors."""
    wrong = [each.file for each in loaded if each.module is None]
    wanted = {PurePosixPath(name.text).stem for names in (imports, *(file.imports for file in wrong)) for name in names}
    found = {each.file.source.path.stem for each in loaded}
    return (wanted - found) | {definition.name.text for file in wrong for definition in file.definitions}


def _is_follow_up(diagnostic: Diagnostic, suspects: Collection[str]) -> bool:
    """Whether a diagnostic may only result from a missing import."""
    if diagnostic.code not in ("unknown-interface", "missing-import"):
        return False
    unlike_any = diagnostic.code == "unknown-interface" and not diagnostic.hint
    return unlike_any or bool(mistyped(diagnostic.span.text, suspects))


def _may_be_imported(diagnostic: Diagnostic) -> bool:
    """Whether a name in an IDSL file may seem wrong only because an import is missing."""
    if diagnostic.code not in ("unknown-type", "unknown-exception", "unknown-interface", "missing-import"):
        return False
    return "::" in diagnostic.span.text or not diagnostic.hint


def _interfaces_in(definitions: Iterable[Definition]) -> dict[str, list[Interface]]:
    found: dict[str, list[Interface]] = {}
    for definition in definitions:
        if isinstance(definition, Interface):
            found.setdefault(definition.short, []).append(definition)
    return found


def _modules(loaded: Sequence[_Loaded[IdslFile]]) -> tuple[Module, ...]:
    """The modules of these files; files that share a module become one."""
    merged: dict[str, Module] = {}
    for module in (each.module for each in loaded if each.module):
        before = merged.get(module.name, Module(module.name, ()))
        known = {definition.name for definition in before.definitions}
        added = (definition for definition in module.definitions if definition.name not in known)
        merged[module.name] = Module(
            module.name, (*before.definitions, *added), tuple(dict.fromkeys((*before.files, *module.files)))
        )
    return tuple(merged.values())
