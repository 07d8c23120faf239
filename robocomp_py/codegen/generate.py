"""Generates files from models, as values: the disk is not touched."""

from __future__ import annotations

import inspect
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import cache
from pathlib import PurePosixPath
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from ..contract import types as t
from ..contract.component import Component, Port
from ..contract.interface import Interface
from ..contract.middleware import AUTO, carrier
from ..contract.module import Constant, Module
from ..errors import RobocompError
from ..spelling import enumerated
from ..version import __version__
from . import actions, configuration, expressions, instances, layout, machine, names, timers
from .compiled import FILE, Compiled
from .imports import bound_names, complete
from .layout import on_one_line
from .linting import excused_file
from .native import native
from .shadows import Shadows


class GenerationError(RobocompError):
    """Nothing was written; the message says why."""


class Owner(Enum):
    GENERATOR = "rewritten on every run"
    USER = "written once, then yours"


@dataclass(frozen=True, slots=True)
class Artifact:
    """One file, below the component's folder."""

    path: PurePosixPath
    text: str
    owner: Owner = Owner.GENERATOR


@dataclass(frozen=True)
class Model:
    """The model of a component, and the names of its files."""

    component: Component
    modules: tuple[Module, ...]
    cdsl: str
    pdsl: str = ""
    middleware: str = AUTO
    statemachine: str = ""


def generate(model: Model) -> tuple[Artifact, ...]:
    """All files of a component: its generic part, and the files that are written once."""
    specific = (Artifact(PurePosixPath(path), text, Owner.USER) for path, text in _specific(model).items())
    return (*generate_generic(model), *specific)


def generate_generic(model: Model) -> tuple[Artifact, ...]:
    """The generic part of a component."""
    return tuple(Artifact(PurePosixPath(path), text) for path, text in _generic(model).items())


def generate_module(module: Module, ports: Sequence[Port] = (), siblings: Sequence[str] = ()) -> str:
    """The Python module of an IDSL module, with proxies for these ports. `siblings` are the other generated modules.

    Raises GenerationError if two definitions would have the same name.
    """
    own = [port for port in ports if port.verb.has_proxy and port.interface.module == module.name]
    proxies = {names.proxy_class(port): port for port in own}
    text = _render("module.py.j2", module=module, ports=list(proxies.values()), aliases=_Aliases())
    text = complete(text, siblings)
    twice = [name for name, number in Counter(bound_names(text)).items() if number > 1]
    if twice:
        files = ", ".join(module.files)
        raise GenerationError(f"{files}: two definitions would be named `{twice[0]}` in Python; rename one")
    return excused_file(text, names.module_name(module.name))


def starter(name: str, lower: str) -> dict[str, str]:
    """The models of a new component by file name: `name` is the name of its interface, `lower` its own."""
    kinds = {f"{lower}.cdsl": "starter.cdsl.j2", f"{name}.idsl": "starter.idsl.j2", f"{lower}.pdsl": "starter.pdsl.j2"}
    return {file: _render(template, name=name, lower=lower) for file, template in kinds.items()}


def starter_specifics(model: Model, name: str) -> dict[PurePosixPath, str]:
    """The files in which a new component has example code instead of empty handlers."""
    kinds = {"specificworker.py": "starter_worker.py.j2", _test(model.component): "starter_test.py.j2"}
    return {PurePosixPath(path): _render(kind, component=model.component, name=name) for path, kind in kinds.items()}


def scene_models(lower: str, scene: str, devices: Sequence[str], own: Sequence[str]) -> dict[str, str]:
    """The models by file name of a component that simulates a scene.

    It provides the interfaces of its devices under the names of these, and others under its own name.
    """
    every = (*devices, *own)
    published = [each for each in every if each.endswith("Pub")]
    implemented = [each for each in every if each not in published]
    values = {"lower": lower, "scene": scene, "implemented": implemented, "published": published, "own": own}
    return {f"{lower}.{kind}": _render(f"scene.{kind}.j2", **values) for kind in ("cdsl", "pdsl")}


def scene_specifics(model: Model, scene: str, bodies: Sequence[Mapping[str, Any]] = ()) -> dict[PurePosixPath, str]:
    """The specific part of a component that simulates a scene. `bodies` are items of its parameter of that name."""
    found = {PurePosixPath("specificworker.py"): _render("scene_worker.py.j2", scene=scene)}
    if bodies:
        lines = ["", *(line for each in bodies for line in configuration.toml_item("params.bodies", each)), ""]
        found[PurePosixPath("etc/config.toml")] = _render("config.toml.j2", **_common(model)) + "\n".join(lines)
    return found


def _generic(model: Model) -> dict[str, str]:
    component = model.component
    siblings = [names.module_name(module.name) for module in model.modules]
    texts = {"generic/__init__.py": _render("generic_init.py.j2", **_common(model))}
    for module in model.modules:
        text = generate_module(module, component.ports, siblings)
        texts[f"generic/{names.module_name(module.name)}.py"] = text
    text = _render("genericworker.py.j2", **_common(model), aliases=_Aliases())
    texts["generic/genericworker.py"] = complete(text, siblings)
    common = _common(model)
    if common["proxies"]:
        text = _render("fakes.py.j2", **common, aliases=_Aliases())
        texts["generic/fakes.py"] = excused_file(complete(text, siblings), "fakes")
    if component.params:
        scopes = configuration.scopes_of(component.params)
        text = _render("params.py.j2", component=component, scopes=scopes, pdsl=model.pdsl, aliases=_Aliases())
        texts["generic/params.py"] = excused_file(complete(text, []), "params")
    about = f"Generated from {on_one_line(model.cdsl)} by rcgen {__version__}: edits are lost."
    return texts | native(component, carrier(None, model.middleware), about)


def _specific(model: Model) -> dict[str, str]:
    component = model.component
    siblings = [names.module_name(module.name) for module in model.modules]
    return {
        "__init__.py": _render("init.py.j2", component=component),
        "__main__.py": _render("main.py.j2", component=component),
        "specificworker.py": complete(
            _render("specificworker.py.j2", **_common(model), aliases=_Aliases()),
            siblings,
            ".generic",
            _handler_classes(component),
        ),
        "etc/config.toml": _render("config.toml.j2", **_common(model)),
        "README.md": _render("readme.md.j2", **_common(model), pdsl=model.pdsl, statemachine=model.statemachine),
        _test(component): _render("test_component.py.j2", component=component),
    }


def _handler_classes(component: Component) -> list[str]:
    return [names.handler_class(port) for port in component.named]


def _test(component: Component) -> str:
    return f"tests/test_{names.snake(component.name)}.py"


def _common(model: Model) -> dict[str, Any]:
    component = model.component
    return {
        "component": component,
        "cdsl": model.cdsl,
        "middleware": model.middleware,
        "handlers": component.handlers(),
        "actions": component.actions(),
        "proxies": [port for port in component.ports if port.verb.has_proxy and not port.each],
        "named": component.named,
        "answering": [port for port in component.named if not port.verb.has_proxy],
        "states": machine.states_of(component),
    }


class _Aliases:
    """The aliases that a file already defines."""

    def __init__(self) -> None:
        self._made: set[str] = set()

    def new(self, shadows: Shadows) -> list[str]:
        found = [alias for alias in shadows.aliases() if alias not in self._made]
        self._made.update(found)
        return found


def _render(template: str, **values: Any) -> str:
    return environment().get_template(template).render(version=__version__, **values)


@cache
def environment() -> Environment:
    """The templates, and what they may use."""
    made = Environment(
        loader=PackageLoader("robocomp_py.codegen"),
        bytecode_cache=Compiled(FILE.read_text(encoding="utf-8")),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,  # Python and TOML, not HTML
    )
    for filters in (names, layout, expressions, configuration, machine, timers, instances, actions):
        made.filters |= {
            name: each
            for name, each in vars(filters).items()
            if inspect.isfunction(each) and each.__module__ == filters.__name__ and not name.startswith("_")
        }
    made.tests["kind"] = lambda value, *kinds: isinstance(value, tuple(_KINDS[kind] for kind in kinds))
    made.filters["of"] = _definitions
    made.filters["enumerated"] = enumerated
    return made


def _definitions(module: Module, *kinds: str) -> list[Any]:
    return [each for each in module.definitions if isinstance(each, tuple(_KINDS[kind] for kind in kinds))]


_KINDS: Mapping[str, type] = {
    "Struct": t.Struct,
    "Enumeration": t.Enumeration,
    "ExceptionType": t.ExceptionType,
    "Sequence": t.Sequence,
    "Dictionary": t.Dictionary,
    "Constant": Constant,
    "Interface": Interface,
}
