"""What a model defines and what it uses, in one form for all languages.

A use is a word that names something defined elsewhere, perhaps in another file. `index` finds the definition
by its possible `kinds` and, if it matters, by its owner (`within`).
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence, Set
from dataclasses import dataclass, field
from enum import StrEnum

from ..dsl.cdsl.model import Component, Item, Timer
from ..dsl.ddsl.allow import Path, split
from ..dsl.ddsl.clauses import Refers, referring
from ..dsl.ddsl.model import Deployment, Instance, Offer, System
from ..dsl.idsl import model as idsl
from ..dsl.idsl.check import BUILTIN
from ..dsl.pdsl import model as pdsl
from ..dsl.smdsl import model as smdsl
from ..dsl.smdsl.ends import shared
from ..dsl.source import Name, Source, Span

Model = idsl.File | Component | pdsl.File | Deployment | smdsl.File


class Kind(StrEnum):
    """The kind of a named thing, as shown to people."""

    MODULE = "module"
    STRUCT = "struct"
    ENUM = "enum"
    ENUMERATOR = "enumerator"
    EXCEPTION = "exception"
    SEQUENCE = "sequence"
    DICTIONARY = "dictionary"
    CONST = "const"
    FIELD = "field"
    INTERFACE = "interface"
    OPERATION = "operation"
    ARGUMENT = "argument"
    COMPONENT = "component"
    TIMER = "timer"
    PARAMETERS = "parameters"
    LIST = "list"
    PARAMETER = "parameter"
    CHOICE = "choice"
    DEPLOYMENT = "deployment"
    HOST = "host"
    SYSTEM = "system"
    INSTANCE = "instance"
    NAMED = "named instance"
    MACHINE = "state machine"
    STATE = "state"
    NODE = "node"


VALUE_TYPES = (Kind.STRUCT, Kind.ENUM, Kind.SEQUENCE, Kind.DICTIONARY)
DEFINITIONS = (*VALUE_TYPES, Kind.EXCEPTION, Kind.CONST, Kind.INTERFACE)


@dataclass(frozen=True, slots=True)
class Symbol:
    """Something with a name, where it is defined. `within` is the qualified name of what it belongs to."""

    kind: Kind
    name: Name
    within: str
    span: Span = field(compare=False)
    """All of its definition."""
    doc: str = field(default="", compare=False)
    detail: str = field(default="", compare=False)
    """A type or a signature, to be shown on the same line."""
    children: tuple[Symbol, ...] = field(default=(), compare=False)

    @property
    def qualified(self) -> str:
        return f"{self.within}::{self.name}" if self.within else self.name.text

    def walk(self) -> Iterator[Symbol]:
        yield self
        for child in self.children:
            yield from child.walk()


@dataclass(frozen=True, slots=True)
class Use:
    """A word that names something. `implied`: only because it has the same name; see `rename`."""

    name: Name
    kinds: tuple[Kind, ...]
    within: str | None = None
    implied: bool = False
    owner: str = ""
    """The last part of `within`, if the rest of it is not known."""


@dataclass(frozen=True, slots=True)
class Link:
    """A named file. An import has an `ending` and is searched for; other files are beside the model."""

    name: Name
    ending: str = ""


@dataclass(frozen=True, slots=True)
class Outline:
    """All of it for one file."""

    source: Source
    symbols: tuple[Symbol, ...]
    uses: tuple[Use, ...] = ()
    links: tuple[Link, ...] = ()

    def walk(self) -> Iterator[Symbol]:
        for each in self.symbols:
            yield from each.walk()


def outline(model: Model) -> Outline:
    match model:
        case idsl.File():
            return _of_interfaces(model)
        case Component():
            return _of_component(model)
        case pdsl.File():
            return _of_parameters(model)
        case Deployment():
            return _of_deployment(model)
        case smdsl.File():
            return _of_machine(model)


# IDSL.


def _of_interfaces(file: idsl.File) -> Outline:
    module = file.module.text
    children = tuple(_definition(each, module) for each in file.definitions)
    whole = file.module.span
    for each in file.definitions:
        whole = whole.to(each.span)
    return Outline(
        file.source,
        (Symbol(Kind.MODULE, file.module, "", whole, children=children),),
        tuple(use for each in file.definitions for use in _uses_in(each, module)),
        tuple(Link(each, ".idsl") for each in file.imports),
    )


def _definition(definition: idsl.Definition, module: str) -> Symbol:
    inside = f"{module}::{definition.name}"
    detail, children = "", tuple[Symbol, ...]()
    match definition:
        case idsl.Struct(fields=fields):
            kind, children = Kind.STRUCT, _fields(fields, inside)
        case idsl.Exception_(fields=fields, bases=bases):
            kind, children = Kind.EXCEPTION, _fields(fields, inside)
            detail = _extends(bases)
        case idsl.Enum(members=members):
            kind = Kind.ENUM
            children = tuple(Symbol(Kind.ENUMERATOR, each.name, inside, each.span) for each in members)
        case idsl.Sequence(item=item, records=records):
            kind, detail = Kind.SEQUENCE, f"{_RECORDS if records else ''}sequence<{type_text(item)}>"
        case idsl.Dictionary(key=key, value=value):
            kind, detail = Kind.DICTIONARY, f"dictionary<{type_text(key)}, {type_text(value)}>"
        case idsl.Const(type=kind_of, value=value):
            kind, detail = Kind.CONST, f"{type_text(kind_of)} = {value.text}"
        case idsl.Interface(operations=operations, bases=bases):
            kind, detail = Kind.INTERFACE, _extends(bases)
            children = tuple(_operation(each, inside) for each in operations)
    return Symbol(kind, definition.name, module, definition.span, definition.doc, detail, children)


def _extends(bases: Iterable[Name]) -> str:
    names = ", ".join(map(str, bases))
    return f"extends {names}" if names else ""


def _fields(fields: Iterable[idsl.Field], inside: str) -> tuple[Symbol, ...]:
    return tuple(Symbol(Kind.FIELD, each.name, inside, each.span, each.doc, type_text(each.type)) for each in fields)


def _operation(operation: idsl.Operation, inside: str) -> Symbol:
    name = f"{inside}::{operation.name}"
    arguments = tuple(
        Symbol(Kind.ARGUMENT, each.name, name, each.span, "", ("out " if each.out else "") + type_text(each.type))
        for each in (*operation.params, *operation.feedback)
    )
    return Symbol(
        Kind.OPERATION, operation.name, inside, operation.span, operation.doc, operation.text, children=arguments
    )


def type_text(kind: idsl.TypeName) -> str:
    if isinstance(kind, Name):
        return kind.text
    return f"{_RECORDS if kind.records else ''}sequence<{type_text(kind.item)}>"


_RECORDS = "[records] "


def _uses_in(definition: idsl.Definition, module: str) -> Iterator[Use]:
    match definition:
        case idsl.Struct(fields=fields):
            yield from _uses_of_fields(fields, module)
        case idsl.Exception_(fields=fields, bases=bases):
            yield from (_definition_use(each, (Kind.EXCEPTION,), module) for each in bases)
            yield from _uses_of_fields(fields, module)
        case idsl.Sequence(item=item):
            yield from _uses_of_type(item, module)
        case idsl.Dictionary(key=key, value=value):
            yield from _uses_of_type(key, module)
            yield from _uses_of_type(value, module)
        case idsl.Const(type=kind, value=value):
            yield from _uses_of_type(kind, module)
            yield from _uses_of_literal(kind, value, module)
        case idsl.Interface(operations=operations, bases=bases):
            yield from (_definition_use(each, (Kind.INTERFACE,), module) for each in bases)
            for operation in operations:
                yield from _uses_of_type(operation.result, module)
                for param in (*operation.params, *operation.feedback):
                    yield from _uses_of_type(param.type, module)
                    yield from _uses_of_literal(param.type, param.default, module)
                yield from (_definition_use(each, (Kind.EXCEPTION,), module) for each in operation.throws)
        case idsl.Enum():
            pass


def _uses_of_fields(fields: Iterable[idsl.Field], module: str) -> Iterator[Use]:
    for each in fields:
        yield from _uses_of_type(each.type, module)
        yield from _uses_of_literal(each.type, each.default, module)


def _uses_of_type(kind: idsl.TypeName, module: str) -> Iterator[Use]:
    if isinstance(kind, idsl.SequenceOf):
        yield from _uses_of_type(kind.item, module)
    elif kind.text not in BUILTIN and kind.text != "void":
        yield _definition_use(kind, VALUE_TYPES, module)


def _uses_of_literal(kind: idsl.TypeName, literal: idsl.Literal | None, module: str) -> Iterator[Use]:
    """An enumerator, if it can be one."""
    if literal and not literal.quoted and isinstance(kind, Name) and kind.text not in BUILTIN:
        enum, name = _qualified(kind, module), _last(Name(literal.text, literal.span))
        yield Use(name, (Kind.ENUMERATOR,), enum)


def _definition_use(name: Name, kinds: tuple[Kind, ...], module: str) -> Use:
    return Use(_last(name), kinds, name.text.rpartition("::")[0] or module)


def _qualified(name: Name, module: str) -> str:
    return name.text if "::" in name.text else f"{module}::{name}"


def _last(name: Name) -> Name:
    """The last word of a qualified name."""
    word = name.text.rpartition("::")[2]
    span = name.span
    return name if word == name.text else Name(word, span.source.span(span.end - len(word), span.end))


# CDSL.


def _of_component(model: Component) -> Outline:
    ports = ", ".join(f"{item.verb} {item.interface}{' each' if item.each else ''}" for item in model.items)
    links = [Link(each, ".idsl") for each in model.imports]
    links += [Link(clause.names[0]) for kind in ("params", "statemachine") for clause in model.all(kind)]
    timers = tuple(_timer(each, model.name.text) for each in model.timers)
    return Outline(
        model.source,
        (Symbol(Kind.COMPONENT, model.name, "", model.span, model.doc, ports, timers),),
        tuple(use for item in model.items for use in _uses_of_item(item)),
        tuple(links),
    )


def _uses_of_item(item: Item) -> Iterator[Use]:
    yield Use(item.interface, (Kind.INTERFACE,))
    for action, _ in item.policies:
        yield Use(action, (Kind.OPERATION,), owner=item.interface.text)


def _timer(timer: Timer, within: str) -> Symbol:
    doc = f"Calls `{timer.method}` on the clock of the component. In code: `self.timers.{timer.name}.period`, in s."
    return Symbol(Kind.TIMER, timer.name, within, timer.name.span.to(timer.period.span), doc, timer.period.span.text)


# PDSL.


def _of_parameters(file: pdsl.File) -> Outline:
    return Outline(
        file.source,
        (_scope(file.scope, Kind.PARAMETERS, ""),),
        tuple(_uses_of_choices(file.scope, "")),
        tuple(Link(each, ".pdsl") for each in file.imports),
    )


def _scope(scope: pdsl.Scope, kind: Kind, within: str, doc: str = "") -> Symbol:
    inside = _inside(scope, within)
    children = [_parameter(each, inside) for each in scope.params]
    children += [_scope(each.scope, Kind.LIST, inside, each.doc) for each in scope.lists]
    return Symbol(kind, scope.name, within, scope.span, doc, "", tuple(children))


def _parameter(param: pdsl.Param, inside: str) -> Symbol:
    bounds = f" {param.range[0]}:{param.range[1]}" if param.range else ""
    words = [word for word, given in (("mandatory", param.mandatory), ("dynamic", param.dynamic)) if given]
    detail = " ".join([f"{param.kind} {param.default}{bounds}", *words])
    choices = tuple(Symbol(Kind.CHOICE, each, f"{inside}::{param.name}", each.span) for each in param.values)
    return Symbol(Kind.PARAMETER, param.name, inside, param.span, param.doc, detail, choices)


def _uses_of_choices(scope: pdsl.Scope, within: str) -> Iterator[Use]:
    inside = _inside(scope, within)
    for param in scope.params:
        if param.kind == "enum":
            yield Use(param.default, (Kind.CHOICE,), f"{inside}::{param.name}")
    for each in scope.lists:
        yield from _uses_of_choices(each.scope, inside)


def _inside(scope: pdsl.Scope, within: str) -> str:
    return f"{within}::{scope.name}" if within else scope.name.text


# DDSL.


def _of_deployment(model: Deployment) -> Outline:
    within = model.name.text
    hosts = tuple(
        Symbol(Kind.HOST, each.name, within, each.span, detail=str(each.address or "")) for each in model.hosts
    )
    children = (*hosts, *_parts(model, ()))
    further = {offer.name.text for each in model.instances for offer in _further(each)}
    return Outline(
        model.source,
        (Symbol(Kind.DEPLOYMENT, model.name, "", model.span, children=children),),
        (
            *(use for each in model.instances for use in _uses_of_instance(each, within, further)),
            *(use for block in _blocks(model) for use in _references(model, block)),
        ),
        (
            *(Link(each, ".cdsl") for each in model.imports),
            *(Link(name) for each in model.instances for name in (each.path, each.config) if name),
        ),
    )


def _blocks(model: Deployment) -> Iterator[Deployment | System | Instance]:
    yield model
    yield from model.systems
    yield from model.instances


def _references(model: Deployment, block: Deployment | System | Instance) -> Iterator[Use]:
    """The uses in the names of clauses."""
    within = model.name.text
    for what, name in referring(block):
        match what:
            case Refers.INSTANCE:
                yield from _uses_of_whole(name, within)
            case Refers.HOST:
                yield Use(name, (Kind.HOST,), within)
            case Refers.OPERATION if not isinstance(block, System):
                yield from _uses_of_allowed(split(model, block, name), within)
            case Refers.MIDDLEWARE | Refers.OPERATION:
                pass


def _uses_of_allowed(path: Path | None, within: str) -> Iterator[Use]:
    if path is None:
        return
    if path.lead:
        yield from (_uses_of_named if path.named else _uses_of_whole)(path.lead, within)
    interface = _without_number(path.port)
    yield Use(interface, (Kind.INTERFACE,))
    if path.operation:
        yield Use(path.operation, (Kind.OPERATION,), owner=interface.text)


def _parts(model: Deployment, system: tuple[str, ...]) -> Iterator[Symbol]:
    """The instances and systems of a system, or of the network, in the order of the file."""
    within = "::".join((model.name.text, *system))
    inside: list[Instance | System] = [each for each in model.instances if each.system == system]
    inside += [each for each in model.systems if tuple(each.name.text.split("/")[:-1]) == system]
    for each in sorted(inside, key=lambda each: each.span.start):
        path = tuple(each.name.text.split("/"))
        name = Name(path[-1], each.name.span)
        if isinstance(each, Instance):
            offers = tuple(_offer(offer, within) for offer in _further(each))
            yield Symbol(Kind.INSTANCE, name, within, each.span, detail=each.component.text, children=offers)
        else:
            yield Symbol(Kind.SYSTEM, name, within, each.span, children=tuple(_parts(model, path)))


def _further(instance: Instance) -> list[Offer]:
    """The named instances of an instance that have another name than it."""
    return [offer for offer in instance.offers if offer.name.text != instance.name.text]


def _offer(offer: Offer, within: str) -> Symbol:
    interfaces = ", ".join(map(str, offer.interfaces))
    return Symbol(Kind.NAMED, Name(offer.local, offer.name.span), within, offer.span, detail=interfaces)


def _uses_of_instance(instance: Instance, within: str, named: Set[str]) -> Iterator[Use]:
    """`named` has all named instances of the network."""
    yield Use(instance.component, (Kind.COMPONENT,), "", implied=instance.kind is None)
    for port in (*(each.port for each in instance.wirings), *(each.port for each in instance.qos)):
        yield Use(_without_number(port), (Kind.INTERFACE,))
        if re.search(r"\d$", port.text):
            yield Use(port, (Kind.INTERFACE,))
    for offer in instance.offers:
        yield from (Use(each, (Kind.INTERFACE,)) for each in offer.interfaces)
        if offer.name.text == instance.name.text:
            yield from _uses_of_whole(offer.name, within)
    for wiring in instance.wirings:
        if wiring.instance.text in named:
            yield from _uses_of_named(wiring.instance, within)
        else:
            yield from _uses_of_whole(wiring.instance, within)


def _uses_of_whole(name: Name, within: str) -> Iterator[Use]:
    """The uses in a written instance name: its systems and the instance itself."""
    *systems, _ = name.text.split("/")
    return _uses_of_path(name, (*_systems(systems), (Kind.INSTANCE, systems)), within)


def _uses_of_named(name: Name, within: str) -> Iterator[Use]:
    """The uses in `left/front` or `left/world/front`: its systems, the instance that offers it, and itself."""
    *systems, _ = name.text.split("/")
    is_short = f"/{name.text}".endswith(f"/{name.span.text.lstrip('/')}")
    offering = [] if is_short else [(Kind.INSTANCE, systems)]
    return _uses_of_path(name, (*_systems(systems), *offering, (Kind.NAMED, systems)), within)


def _systems(path: list[str]) -> Iterator[tuple[Kind, list[str]]]:
    return ((Kind.SYSTEM, path[:depth]) for depth in range(len(path)))


def _uses_of_path(name: Name, path: Sequence[tuple[Kind, list[str]]], within: str) -> Iterator[Use]:
    """The uses in a name, of whose full form `path` has each part's kind and the systems around it."""
    written = list(re.finditer(r"\w+", name.span.text))
    for found, (kind, systems) in zip(written, path[-len(written) :], strict=True):
        span = name.span.source.span(name.span.start + found.start(), name.span.start + found.end())
        yield Use(Name(found[0], span), (kind,), "::".join((within, *systems)))


def _without_number(port: Name) -> Name:
    """The interface of a port: `Laser` of `Laser1`."""
    word = port.text.rstrip("0123456789") or port.text
    return Name(word, port.span.source.span(port.span.start, port.span.start + len(word)))


# SMDSL.


def _of_machine(file: smdsl.File) -> Outline:
    within, alike, known = file.name.text, shared(file), set[str]()
    states, uses, whole = list[Symbol](), dict[Span, Name](), file.name.span
    for block in file.blocks:
        inside = f"in {block.parent}" if block.parent else ""
        states += [Symbol(Kind.STATE, each.name, within, each.name.span, detail=inside) for each in block.states]
        ends = [end for each in block.transitions for end in (each.source, each.target)]
        uses |= {each.span: each for each in (block.parent, *ends) if each}  # one source may have several targets
        # End states of one name share a method, so they are renamed together: the first is used by the others.
        uses |= {each.name.span: each.name for each in block.states if each.name.text in known}
        known |= {each.name.text for each in block.states if each.name.text in alike}
        whole = whole.to(block.span)
    return Outline(
        file.source,
        (Symbol(Kind.MACHINE, file.name, "", whole, children=tuple(states)),),
        tuple(Use(each, (Kind.STATE,), within) for each in uses.values()),
    )
