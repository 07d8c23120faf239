"""Models to files, as values. Nothing here touches the disk."""

from __future__ import annotations

import inspect
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import PurePosixPath
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from .. import __version__
from ..contract import types as t
from ..contract.component import Component, Port
from ..contract.interface import Interface, Operation
from ..contract.module import Constant, Module
from ..contract.parameters import ParameterSet
from . import python as py

DEFAULT_MIDDLEWARE = "zeromq"


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
    """What a component is generated from, and the names of the files that say so."""

    component: Component
    modules: tuple[Module, ...]
    cdsl: str
    pdsl: str = ""
    middleware: str = DEFAULT_MIDDLEWARE


def generate(model: Model) -> tuple[Artifact, ...]:
    """All files of a component: its generic part, and what is written once."""
    return (*_generic(model), *_specific(model))


def generate_module(module: Module, ports: Sequence[Port] = ()) -> str:
    """The Python module of an IDSL module, with proxies for these ports."""
    own = [port for port in ports if port.verb.has_proxy and port.interface.module == module.name]
    unique = {py.proxy_class(port): port for port in own}
    return _render("module.py.j2", module=module, ports=list(unique.values()))


def starter(name: str) -> dict[str, str]:
    """The models of a new component, by file name."""
    lower = name.lower()
    kinds = {f"{lower}.cdsl": "starter.cdsl.j2", f"{name}.idsl": "starter.idsl.j2", f"{lower}.pdsl": "starter.pdsl.j2"}
    return {file: _render(template, name=name, lower=lower) for file, template in kinds.items()}


def starter_specifics(model: Model, name: str) -> dict[PurePosixPath, str]:
    """What a starter has instead of empty handlers."""
    return {
        PurePosixPath("specificworker.py"): _render("starter_worker.py.j2", component=model.component, name=name),
        PurePosixPath(f"tests/test_{py.snake(model.component.name)}.py"): _render(
            "starter_test.py.j2", component=model.component, name=name
        ),
    }


def _generic(model: Model) -> Iterator[Artifact]:
    component = model.component
    yield Artifact(PurePosixPath("generic/__init__.py"), _render("generic_init.py.j2", **_common(model)))
    for module in model.modules:
        yield Artifact(PurePosixPath(f"generic/{module.name}.py"), generate_module(module, component.ports))
    text = _render("genericworker.py.j2", **_common(model))
    yield Artifact(PurePosixPath("generic/genericworker.py"), text)
    if component.params:
        scopes = list(_scopes(component.params))
        text = _render("params.py.j2", component=component, scopes=scopes, pdsl=model.pdsl)
        yield Artifact(PurePosixPath("generic/params.py"), text)


def _specific(model: Model) -> Iterator[Artifact]:
    component = model.component
    once = {
        "__init__.py": _render("init.py.j2", component=component),
        "__main__.py": _render("main.py.j2", component=component),
        "specificworker.py": _render("specificworker.py.j2", **_common(model)),
        "etc/config.toml": _render("config.toml.j2", **_common(model)),
        "README.md": _render("readme.md.j2", **_common(model), pdsl=model.pdsl),
        f"tests/test_{py.snake(component.name)}.py": _render("test_component.py.j2", component=component),
    }
    for path, text in once.items():
        yield Artifact(PurePosixPath(path), text, Owner.USER)


def _common(model: Model) -> dict[str, Any]:
    component = model.component
    return {
        "component": component,
        "cdsl": model.cdsl,
        "middleware": model.middleware,
        "handlers": list(_handlers(component)),
        "proxies": [port for port in component.ports if port.verb.has_proxy],
    }


def _handlers(component: Component) -> Iterator[tuple[Port, Operation[Any]]]:
    for port in component.ports:
        if not port.verb.has_proxy:
            for operation, _ in port.interface.under(port.verb):
                yield port, operation


def _scopes(params: ParameterSet, name: str = "Params") -> Iterator[tuple[str, ParameterSet]]:
    """Every scope with the name of its class, inner ones first."""
    for each in params.lists:
        yield from _scopes(each.items, py.item_class(each.items))
    yield name, params


def _render(template: str, **values: Any) -> str:
    return _ENVIRONMENT.get_template(template).render(version=__version__, **values)


def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("robocomp_py.codegen"),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,  # Python and TOML, not HTML
    )
    filters = {name: each for name, each in vars(py).items() if inspect.isfunction(each) and not name.startswith("_")}
    environment.filters |= {name: each for name, each in filters.items() if each.__module__ == py.__name__}
    environment.tests["kind"] = lambda value, *names: isinstance(value, tuple(_KINDS[name] for name in names))
    environment.filters["of"] = _definitions
    return environment


def _definitions(module: Module, *names: str) -> list[Any]:
    return [each for each in module.definitions if isinstance(each, tuple(_KINDS[name] for name in names))]


_KINDS: Mapping[str, type] = {
    "Struct": t.Struct,
    "Enumeration": t.Enumeration,
    "ExceptionType": t.ExceptionType,
    "Sequence": t.Sequence,
    "Dictionary": t.Dictionary,
    "Constant": Constant,
    "Interface": Interface,
}
_ENVIRONMENT = _environment()
