"""Renames something of a model in the Python code that uses it. Certain places are changed, others are listed.

    handlers, methods of timers and of states       everywhere: `Vault_size`, `timer_poll`, `sm_resting`
    operations of proxies, parameters, timers       after `self.vault_proxy`, `self.params`, `self.timers`, and names
                                                    that hold nothing else: `vault = self.vault_proxy`
    texts and fakes of tests                        `"Vault.size"`, `vault={"size": …}`
    named instances                                 in `self.laser.add("front", …)`, `self.laser["front"]` and the like

Which names those are is found by comparing the component before and after its models were changed.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import libcst as cst

from ..codegen.actions import as_operation
from ..codegen.expressions import can_lend, fakes_class
from ..codegen.names import loan, method, proxy_class, short, twin
from ..contract.component import Component, Port
from ..contract.interface import Action, Pattern
from ..contract.naming import feedback_struct, goal_class

_PARAMS, _TIMERS = "params", "timers"
_HARNESS = "ComponentTest"


class NotParsed(ValueError):
    """Why a file is left alone."""


@dataclass(frozen=True)
class Names:
    """The names that change in Python: each old name with its new one."""

    words: dict[str, str] = field(default_factory=dict)
    """Names that mean the same everywhere."""
    members: dict[str, dict[str, str]] = field(default_factory=dict)
    """By the attribute before them, a proxy's or `params`."""
    texts: dict[str, str] = field(default_factory=dict)
    ports: dict[str, str] = field(default_factory=dict)
    keys: dict[str, dict[str, str]] = field(default_factory=dict)
    """Operations by the port that a test has a fake for, and by the class of its fakes."""
    classes: dict[str, str] = field(default_factory=dict)
    """The attribute of each class of proxies: what a parameter of that type is."""

    instances: dict[str, dict[str, str]] = field(default_factory=dict)
    """By the attribute of an interface, its named instances."""

    def __bool__(self) -> bool:
        return any((self.instances, self.words, self.members, self.texts, self.ports, self.keys))


@dataclass(frozen=True)
class Rewritten:
    """A file with the new names."""

    data: bytes
    left: tuple[tuple[int, str], ...]
    """Lines, in the new text, that may mean the old name, too."""


def differences(before: Component, after: Component) -> Names:
    """The names in Python that differ between two versions of one component."""
    found = Names()
    for old, new in zip(before.ports, after.ports, strict=True):
        _of_port(old, new, found)
    if before.machine and after.machine:
        states = zip(before.machine.every_state(), after.machine.every_state(), strict=True)
        _note(found.words, ((old.method, new.method) for old, new in states))
        transitions = zip(before.machine.transitions, after.machine.transitions, strict=True)
        _note(found.words, ((old.trigger, new.trigger) for old, new in transitions))
    timers = list(zip(before.timers, after.timers, strict=True))
    _note(found.words, ((old.method, new.method) for old, new in timers))
    periods: dict[str, str] = {}
    _note(periods, ((old.name, new.name) for old, new in timers))
    if periods:
        found.members[_TIMERS] = periods
    if before.params and after.params:
        values = zip(before.params.parameters, after.params.parameters, strict=True)
        lists = zip(before.params.lists, after.params.lists, strict=True)
        changed: dict[str, str] = {}
        _note(changed, ((old.name, new.name) for old, new in values))
        _note(changed, ((old.name, new.name) for old, new in lists))
        if changed:
            found.members[_PARAMS] = changed
    return found


def _of_port(old: Port, new: Port, found: Names) -> None:
    pairs = list(zip(old.interface.under(old.verb), new.interface.under(new.verb), strict=True))
    calls: dict[str, str] = {}
    for (was, pattern), (now, _) in pairs:
        _note(found.texts, [(f"{name(old)}.{was.name}", f"{name(new)}.{now.name}") for name in (_label, _name)])
        if not old.verb.has_proxy:
            _note(found.words, [(old.handler(was.name), new.handler(now.name))])
            continue
        _note(calls, [(method(was), method(now))])
        if pattern is Pattern.QUERY:
            _note(calls, [(twin(was, old.interface), twin(now, new.interface))])
        if can_lend(was, pattern):
            _note(calls, [(loan(was, old.interface), loan(now, new.interface))])
    goals = list(zip(old.interface.actions_under(old.verb), new.interface.actions_under(new.verb), strict=True))
    for begun, renamed in goals:
        _note(found.texts, [(f"{name(old)}.{begun.name}", f"{name(new)}.{renamed.name}") for name in (_label, _name)])
        if old.verb.has_proxy:
            _note(calls, [(method(as_operation(begun)), method(as_operation(renamed)))])
        else:
            _note(found.words, [(old.handler(begun.name), new.handler(renamed.name))])
        _note(found.words, list(zip(_classes(old, begun), _classes(new, renamed), strict=True)))
    _note(found.ports, [(old.name, new.name)])
    if not old.verb.has_proxy:
        return
    _note(found.words, [(old.attribute, new.attribute), (proxy_class(old), proxy_class(new))])
    _note(found.words, [(fakes_class(old), fakes_class(new))])
    keys: dict[str, str] = {}
    _note(keys, ((was.name, now.name) for (was, _), (now, _) in pairs))
    _note(keys, ((was.name, now.name) for was, now in goals))
    if calls:
        found.members[old.attribute] = calls
        found.classes[proxy_class(old)] = old.attribute
    if keys:
        found.keys[old.name] = found.keys[fakes_class(old)] = keys


def _classes(port: Port, action: Action) -> tuple[str, str]:
    """The names of the generated classes of an action with feedback."""
    origin = short(action.origin) or port.interface.short
    return feedback_struct(origin, action.name), goal_class(origin, action.name)


def _label(port: Port) -> str:
    return port.label


def _name(port: Port) -> str:
    return port.name


def _note(into: dict[str, str], pairs: Sequence[tuple[str, str]] | Iterator[tuple[str, str]]) -> None:
    into.update((old, new) for old, new in pairs if old != new)


def rewrite(data: bytes, names: Names) -> Rewritten:
    """A Python file with the new names. Raises NotParsed."""
    try:
        module = cst.parse_module(data)
    except (cst.ParserSyntaxError, UnicodeDecodeError, RecursionError) as exc:
        raise NotParsed(str(getattr(exc, "message", exc))) from exc
    holders = _Holders(names)
    module.visit(holders)
    changed = module.visit(_Renamer(names, holders.found()))
    return Rewritten(changed.bytes, tuple(_left(changed.code, names)))


def words_in(data: bytes, words: Sequence[str]) -> list[str]:
    """Which of these names a file already uses."""
    try:
        module = cst.parse_module(data)
    except (cst.ParserSyntaxError, UnicodeDecodeError, RecursionError):
        return []
    seen = _Words()
    module.visit(seen)
    return [word for word in words if word in seen.words]


class _Words(cst.CSTVisitor):
    def __init__(self) -> None:
        self.words: set[str] = set()

    def visit_Name(self, node: cst.Name) -> None:
        self.words.add(node.value)


class _Holders(cst.CSTVisitor):
    """Finds names and attributes that only ever hold a proxy."""

    def __init__(self, names: Names) -> None:
        self._names = names
        self._given: dict[str, set[str]] = {}

    def found(self) -> dict[str, str]:
        """The attribute of the proxy that each holder holds, by the text of the holder."""
        return {
            holder: given.copy().pop()
            for holder, given in self._given.items()
            if len(given) == 1 and given <= self._names.members.keys()
        }

    def visit_Assign(self, node: cst.Assign) -> None:
        for each in node.targets:
            self._give(each.target, _attribute(node.value))

    def visit_AnnAssign(self, node: cst.AnnAssign) -> None:
        self._give(node.target, _attribute(node.value) if node.value else self._annotated(node.annotation))

    def visit_Param(self, node: cst.Param) -> None:
        self._give(node.name, self._annotated(node.annotation))

    def visit_For(self, node: cst.For) -> None:
        self._give(node.target, "")

    def visit_AsName(self, node: cst.AsName) -> None:
        self._give(node.name, "")

    def visit_NamedExpr(self, node: cst.NamedExpr) -> None:
        self._give(node.target, _attribute(node.value))

    def visit_CompFor(self, node: cst.CompFor) -> None:
        self._give(node.target, "")

    def _give(self, target: cst.CSTNode, what: str) -> None:
        if isinstance(target, cst.Tuple | cst.List):
            for each in target.elements:
                self._give(each.value, "")
        elif text := _text(target):
            self._given.setdefault(text, set()).add(what)

    def _annotated(self, annotation: cst.Annotation | None) -> str:
        """The attribute of a proxy whose class an annotation names."""
        text = _last(annotation.annotation) if annotation else ""
        return self._names.classes.get(text, "")


class _Renamer(cst.CSTTransformer):
    def __init__(self, names: Names, holders: Mapping[str, str]) -> None:
        self._names, self._holders = names, holders

    def leave_Name(self, original_node: cst.Name, updated_node: cst.Name) -> cst.Name:
        new = self._names.words.get(original_node.value)
        return updated_node.with_changes(value=new) if new else updated_node

    def leave_Attribute(self, original_node: cst.Attribute, updated_node: cst.Attribute) -> cst.Attribute:
        holder = _last(original_node.value)
        proxy = holder if holder in self._names.members else self._holders.get(_text(original_node.value), "")
        new = self._names.members.get(proxy, {}).get(original_node.attr.value)
        return updated_node.with_changes(attr=updated_node.attr.with_changes(value=new)) if new else updated_node

    def leave_SimpleString(self, original_node: cst.SimpleString, updated_node: cst.SimpleString) -> cst.SimpleString:
        value = original_node.evaluated_value
        new = {**self._names.words, **self._names.texts}.get(value) if isinstance(value, str) else None
        return _said(updated_node, str(value), new) if new else updated_node

    def leave_Subscript(self, original_node: cst.Subscript, updated_node: cst.Subscript) -> cst.Subscript:
        """`self.laser["front"]`"""
        names = self._names.instances.get(_last(original_node.value))
        match updated_node.slice:
            case [cst.SubscriptElement(slice=cst.Index(value=key) as index) as element] if names:
                inner = element.with_changes(slice=index.with_changes(value=_renamed(key, names)))
                return updated_node.with_changes(slice=[inner])
        return updated_node

    def leave_Comparison(self, original_node: cst.Comparison, updated_node: cst.Comparison) -> cst.Comparison:
        """`"front" in self.laser`"""
        names = self._names.instances.get(_last(original_node.comparisons[-1].comparator), {})
        is_in = isinstance(original_node.comparisons[0].operator, cst.In | cst.NotIn)
        return updated_node.with_changes(left=_renamed(updated_node.left, names)) if is_in else updated_node

    def leave_DictElement(self, original_node: cst.DictElement, updated_node: cst.DictElement) -> cst.DictElement:
        port = _constant(original_node.key)
        value = _with_keys(updated_node.value, self._names.keys.get(port, {}))
        return updated_node.with_changes(value=value)

    def leave_Call(self, original_node: cst.Call, updated_node: cst.Call) -> cst.Call:
        function = original_node.func
        if isinstance(function, cst.Attribute) and (named := self._names.instances.get(_last(function.value))):
            return updated_node.with_changes(args=[_with_name(each, named) for each in updated_node.args])
        if keys := self._names.keys.get(_last(original_node.func)):
            return updated_node.with_changes(args=[_with_keyword(each, keys) for each in updated_node.args])
        if _last(original_node.func) != _HARNESS:
            return updated_node
        return updated_node.with_changes(args=[self._fake(each) for each in updated_node.args])

    def leave_AnnAssign(self, original_node: cst.AnnAssign, updated_node: cst.AnnAssign) -> cst.AnnAssign:
        keys = self._names.keys.get(_last(original_node.annotation.annotation), {})
        value = _with_keys(updated_node.value, keys) if updated_node.value else None
        return updated_node.with_changes(value=value)

    def _fake(self, argument: cst.Arg) -> cst.Arg:
        """A fake that a test gives to the harness: `vault={"size": …}`."""
        if argument.keyword is None:
            return argument
        port = argument.keyword.value
        keyword = argument.keyword.with_changes(value=self._names.ports.get(port, port))
        value = _with_keys(argument.value, self._names.keys.get(port, {}))
        return argument.with_changes(keyword=keyword, value=value)


def _with_keyword(argument: cst.Arg, keys: Mapping[str, str]) -> cst.Arg:
    """An argument by another name: `VaultFakes(size=…)`."""
    if argument.keyword is None or argument.keyword.value not in keys:
        return argument
    return argument.with_changes(keyword=argument.keyword.with_changes(value=keys[argument.keyword.value]))


def _with_name(argument: cst.Arg, names: Mapping[str, str]) -> cst.Arg:
    """An argument of a method of named instances: `self.laser.add("front", …)`, or `name="front"`."""
    return argument.with_changes(value=_renamed(argument.value, names))


def _renamed(value: cst.BaseExpression, names: Mapping[str, str]) -> cst.BaseExpression:
    """A text that is one of the names, with its new one."""
    old = _constant(value)
    return _said(value, old, names[old]) if old in names and isinstance(value, cst.SimpleString) else value


def _with_keys(value: cst.BaseExpression, keys: Mapping[str, str]) -> cst.BaseExpression:
    """A dictionary with other keys."""
    if not keys or not isinstance(value, cst.Dict):
        return value
    elements = []
    for each in value.elements:
        old = _constant(each.key) if isinstance(each, cst.DictElement) else ""
        if old in keys and isinstance(each, cst.DictElement) and isinstance(each.key, cst.SimpleString):
            each = each.with_changes(key=_said(each.key, old, keys[old]))
        elements.append(each)
    return value.with_changes(elements=elements)


def _said(node: cst.SimpleString, old: str, new: str) -> cst.SimpleString:
    return node.with_changes(value=node.value.replace(old, new, 1))


def _constant(node: cst.BaseExpression) -> str:
    value = node.evaluated_value if isinstance(node, cst.SimpleString) else ""
    return value if isinstance(value, str) else ""


def _attribute(node: cst.BaseExpression) -> str:
    """The last name of `self.vault_proxy`; None if it is not an attribute."""
    return node.attr.value if isinstance(node, cst.Attribute) else ""


def _last(node: cst.BaseExpression) -> str:
    """The last name of `a.b.c` or `c`."""
    return node.value if isinstance(node, cst.Name) else _attribute(node)


def _text(node: cst.CSTNode) -> str:
    """`name` or `self.name`; nothing of anything else."""
    match node:
        case cst.Name(value=name):
            return name
        case cst.Attribute(value=cst.Name(value="self"), attr=cst.Name(value=name)):
            return f"self.{name}"
        case _:
            return ""


def _left(text: str, names: Names) -> Iterator[tuple[int, str]]:
    """Lines that may mean an old name: comments, texts, and members of what is not known."""
    members = {old for each in names.members.values() for old in each}
    alternatives = [rf"(?<!\w){re.escape(each)}(?!\w)" for each in (*names.words, *names.texts)]
    named = {old for each in names.instances.values() for old in each}
    alternatives += [f"{quote}{re.escape(each)}{quote}" for each in named for quote in "\"'"]
    if any(each in text for each in names.members):
        alternatives += [rf"\.{re.escape(each)}(?=\()" for each in members]
    if not alternatives:
        return
    pattern = re.compile("|".join(alternatives))
    for number, line in enumerate(text.splitlines(), 1):
        if pattern.search(line):
            yield number, line.strip()
