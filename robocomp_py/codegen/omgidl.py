"""Contracts as OMG IDL 4: the messages as programs without robocomp_py see them.

    time         robocomp::Time {int32 sec; uint32 nanosec}
    enumeration  int32, and constants: values may be negative, but an enum of IDL has no negative values
    dictionary   a sequence of {key; value}, named after the dictionary
    empty        one byte, as in ROS 2

All types are final. A file holds the used types of one module, and includes the files of other modules.
"""

from __future__ import annotations

import re
import textwrap
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any

from ..contract import types as t
from ..contract.interface import Operation
from ..contract.module import Constant
from ..printable import spaced
from .basictypes import SPELLED
from .names import module_of, short

WIDTH = 100
"""Line length of IDL files."""


# -- messages as structs ----------------------------------------------------------------

OURS = "robocomp"
"""The module of types that belong to no interface."""

TIME = t.Struct(
    f"{OURS}::Time",
    (t.Field("sec", t.INT32), t.Field("nanosec", t.UINT32)),
    doc="An instant: seconds since 1970, and nanoseconds from 0 to 999999999.",
)
FAILURE = t.Struct(
    f"{OURS}::Failure",
    (t.Field("type", t.STRING), t.Field("message", t.STRING), t.Field("traceback", t.STRING)),
    doc="Why a call failed, in place of its response: a reply of status 2.",
)
REQUEST_HEADER = t.Struct(
    f"{OURS}::RequestHeader",
    (
        t.Field("version", t.UINT8, doc="1"),
        t.Field("flags", t.UINT8, doc="1: no reply wanted (a command); 2: idempotent"),
        t.Field("remaining_ms", t.UINT32, doc="rest of the client's deadline; 0xffffffff: no limit"),
        t.Field("fingerprint", t.UINT64, doc="of the operation"),
        t.Field("client", t.UINT64, doc="random number of the client"),
        t.Field("sequence", t.UINT64, doc="number of the message of this client on this channel, from 1"),
        t.Field("stamp", t.INT64, doc="ns since 1970"),
    ),
    doc="In front of every request and command.",
)
REPLY_HEADER = t.Struct(
    f"{OURS}::ReplyHeader",
    (
        t.Field("version", t.UINT8, doc="1"),
        t.Field(
            "status", t.UINT8, doc="0: ok, 1: exception, 2: failure, 3: expired, 4: mismatch, 5: busy, 6: not served"
        ),
        t.Field("client", t.UINT64, doc="that of the request"),
        t.Field("sequence", t.UINT64, doc="that of the request"),
        t.Field("server", t.UINT64, doc="random number of the server, new at every start"),
        t.Field("stamp", t.INT64, doc="ns since 1970"),
    ),
    doc="In front of every reply. If its status is not 0, the response is empty; see `error`.",
)
PUBLICATION_HEADER = t.Struct(
    f"{OURS}::PublicationHeader",
    (
        t.Field("version", t.UINT8, doc="1"),
        t.Field("fingerprint", t.UINT64, doc="of the operation"),
        t.Field("source", t.UINT64, doc="random number of the publisher"),
        t.Field("sequence", t.UINT64, doc="number of the message of this publisher, from 1"),
        t.Field("stamp", t.INT64, doc="ns since 1970"),
    ),
    doc="In front of every publication.",
)
CREDIT = t.Struct(
    f"{OURS}::Credit",
    (
        t.Field("reader", t.UINT64),
        t.Field("source", t.UINT64),
        t.Field("sequence", t.UINT64, doc="the last message that the reader has taken"),
        t.Field("window", t.UINT32, doc="number of further messages that it has room for"),
    ),
    doc="Flow control of robocomp_py's readers of a reliable topic. Other readers need not send it.",
)

_NOTHING = t.Field("structure_needs_at_least_one_member", t.UINT8)


def publication_name(operation: Operation[Any]) -> str:
    """`RoboCompLaserPub::LaserPubPushLaserDataPublication`. It differs from the name of the request."""
    return f"{operation.request.name.removesuffix('Request')}Publication"


def publication(operation: Operation[Any], *, headed: bool) -> t.Struct:
    """The struct of a publication; with `headed`, our header is its first member."""
    return _message(publication_name(operation), operation, "published", PUBLICATION_HEADER if headed else None)


def request(operation: Operation[Any], *, headed: bool) -> t.Struct:
    return _message(operation.request.name, operation, "asked", REQUEST_HEADER if headed else None)


def response(operation: Operation[Any], *, headed: bool) -> t.Struct:
    """The struct of a reply; with `headed`, our header is its first member, and its last one holds an error."""
    if not headed:
        return _message(operation.response.name, operation, "answered", None)
    error = t.Field("error", t.Sequence(t.UINT8))
    return _message(operation.response.name, operation, "answered", REPLY_HEADER, error)


def exception(kind: t.ExceptionType) -> t.Struct:
    """The struct of a declared exception in a reply."""
    name = t.Field("exception", t.STRING, doc="its full name, then, after each `<`, the name of its base")
    about = " ".join(filter(None, (kind.doc, "Thrown, in place of a response: a reply of status 1.")))
    return t.Struct(kind.name, (name, *_renamed(kind.all_fields, {"exception"})), doc=about)


def _message(name: str, operation: Operation[Any], what: str, header: t.Struct | None, *more: t.Field) -> t.Struct:
    fields = operation.outputs if what == "answered" else operation.inputs
    if header:
        fields = _renamed((t.Field("header", header), *(fields or (_NOTHING,)), *more), set())
    return t.Struct(name, fields, doc=f"{short(operation.interface)}.{operation.name}, {what}.")


def _renamed(fields: Iterable[t.Field], taken: set[str]) -> tuple[t.Field, ...]:
    """The fields, with underscores appended to names that are taken."""
    found = []
    for field in fields:
        name = field.name
        while name in taken:
            name += "_"
        taken.add(name)
        found.append(replace(field, name=name))
    return tuple(found)


def plain(kind: t.Type) -> t.Type:
    """A type expressed by numbers, strings, sequences, structs and enumerations, which are written as int32."""
    match kind:
        case t.Primitive():
            return TIME if kind is t.TIME else kind
        case t.Enumeration():
            return kind
        case t.Sequence(item):
            return t.Sequence(plain(item))
        case t.Dictionary(key, value, name):
            entry = f"{name}Entry" if name else f"{OURS}::Entry_" + re.sub(r"\W+", "_", t.spell(kind))
            return t.Sequence(t.Struct(entry, (t.Field("key", plain(key)), t.Field("value", plain(value)))))
        case t.Struct(fields=fields):
            return replace(kind, fields=tuple(replace(f, type=plain(f.type)) for f in fields) or (_NOTHING,))


def ambiguous(kinds: Iterable[t.Type]) -> set[str]:
    """The names that stand for different types among these and all that they use. A contract allows such names."""
    known: dict[str, t.Type] = {}
    found: set[str] = set()

    def visit(kind: t.Type) -> None:
        if isinstance(kind, t.Struct | t.Enumeration):
            first = known.setdefault(kind.name, kind)
            if first is not kind:
                if first != kind:
                    found.add(kind.name)
                return
        for child in t.children(kind):
            visit(child)

    for kind in kinds:
        visit(kind)
    return found


# -- files -----------------------------------------------------------------------------


def idl(
    sent: Iterable[t.Type], parts: Iterable[t.Type], head: str, constants: Iterable[Constant] = ()
) -> dict[str, str]:
    """IDL files by name. `sent` are types of messages and `parts` other types; all types that they use are included.

    `head` is the first line of every file.
    """
    whole, inside = list(map(plain, sent)), list(map(plain, parts))
    kinds = list(t.walk(*inside, *whole))
    twice = ambiguous([*inside, *whole])
    topics = {kind.name for kind in whole if isinstance(kind, t.Struct)}
    files = _files(kinds)
    values: dict[str, list[Constant]] = {}
    for each in constants:
        values.setdefault(module_of(each.name), []).append(each)
    files |= {module: module for module in values if module not in files}
    texts: dict[str, str] = {}
    for stem in dict.fromkeys(files.values()):
        mine = [kind for kind in kinds if files[module_of(kind.name)] == stem]
        uses = {files[module_of(used.name)] for kind in mine for used in t.walk(kind)} - {stem}
        fixed = [each for module, found in values.items() if files[module] == stem for each in found]
        texts[f"{stem}.idl"] = "\n".join(_file(stem, mine, sorted(uses), topics, twice, head, fixed)) + "\n"
    return texts


def _files(kinds: Iterable[t.Struct | t.Enumeration]) -> dict[str, str]:
    """The file of each module. Modules that need each other share one."""
    uses: dict[str, set[str]] = {}
    for kind in kinds:
        uses.setdefault(module_of(kind.name), set()).update(module_of(each.name) for each in t.walk(kind))
    for _ in uses:  # the transitive closure
        for reached in uses.values():
            reached.update(*(uses[module] for module in list(reached)))
    return {module: next(first for first in uses if first in uses[module] and module in uses[first]) for module in uses}


def _file(
    stem: str,
    kinds: list[t.Struct | t.Enumeration],
    uses: list[str],
    topics: set[str],
    twice: set[str],
    head: str,
    constants: list[Constant],
) -> Iterator[str]:
    yield f"// {' '.join(head.splitlines())}"
    yield from _notes(kinds, twice)
    yield ""
    guard = f"{stem.upper()}_IDL"
    yield f"#ifndef {guard}"
    yield f"#define {guard}"
    yield ""
    for used in uses:
        yield f'#include "{used}.idl"'
    if uses:
        yield ""
    for module in dict.fromkeys(module_of(each.name) for each in constants):
        yield f"module {_escaped(module)} {{"
        for each in constants:
            yield from (f"    {line}" for line in _constant(each) if module_of(each.name) == module)
        yield "};"
        yield ""
    for module, inside in _runs(kinds):
        yield f"module {_escaped(module)} {{"
        names = {short(kind.name).lower() for kind in kinds if module_of(kind.name) == module}
        for number, kind in enumerate(inside):
            if number:
                yield ""
            # If a type is named `Nested`, idlc confuses the annotation with it.
            nested = kind.name not in topics and "nested" not in names
            lines = _constants(kind) if isinstance(kind, t.Enumeration) else _struct(kind, names, nested)
            yield from (f"    {line}" for line in lines)
        yield "};"
        yield ""
    yield f"#endif  // {guard}"


def _runs(kinds: Iterable[t.Struct | t.Enumeration]) -> list[tuple[str, list[t.Struct | t.Enumeration]]]:
    """Runs of types of the same module, in the order in which they need each other."""
    runs: list[tuple[str, list[t.Struct | t.Enumeration]]] = []
    for kind in kinds:
        if not runs or runs[-1][0] != module_of(kind.name):
            runs.append((module_of(kind.name), []))
        runs[-1][1].append(kind)
    return runs


def _constants(kind: t.Enumeration) -> Iterator[str]:
    yield from comment(" ".join(filter(None, (kind.doc, "Carried as int32."))))
    yield f"module {_escaped(short(kind.name))} {{"
    for member, value in kind.members:
        yield f"    const int32 {_escaped(member)} = {value};"
    yield "};"


def _constant(constant: Constant) -> Iterator[str]:
    kind, value = constant.type, constant.value
    match kind, value:
        case t.Enumeration(members=members), _:
            written = str(dict(members)[value])
        case _, bool():
            written = str(value).upper()
        case _, str():
            escaped = spaced(value).replace("\\", "\\\\")
            written = f'"{escaped}"'
        case _:
            written = str(value)
    yield from comment(": ".join(filter(None, (_enumeration(kind), constant.doc))))
    yield f"const {_spelled(kind, '', set(), set())} {_escaped(short(constant.name))} = {written};"


def _struct(kind: t.Struct, names: set[str], nested: bool) -> Iterator[str]:
    yield from comment(kind.doc)
    yield f"@final {'@nested ' if nested else ''}struct {_escaped(short(kind.name))} {{"
    members = {field.name.lower() for field in kind.fields}
    for field in kind.fields:
        line = f"    {_spelled(field.type, module_of(kind.name), members, names)} {_escaped(field.name)};"
        about = ": ".join(filter(None, (_enumeration(field.type), field.doc)))
        lines = list(comment(about, 12))
        if len(lines) == 1 and len(line) + len(lines[0]) + 6 <= WIDTH:
            yield f"{line}  {lines[0]}"
        else:
            yield from (f"    {each}" for each in lines)
            yield line
    yield "};"


def _spelled(kind: t.Type, module: str, members: set[str], names: set[str]) -> str:
    """The spelling of a type in a struct with these members, in a module with these names."""
    match kind:
        case t.Primitive():
            return SPELLED[kind].omg
        case t.Enumeration():
            return "int32"
        case t.Sequence(item):
            inside = _spelled(item, module, members, names)
            return f"sequence<{inside}{' ' if inside.endswith('>') else ''}>"  # idlc reads `>>` as another token
        case t.Struct(name=name):
            other, own = module_of(name), short(name)
            path = f"{_escaped(other)}::{_escaped(own)}"
            if other == module and own.lower() not in members:
                return _escaped(own)
            return f"::{path}" if other.lower() in members | names else path  # fastddsgen rejects a leading `::`
        case t.Dictionary():
            raise AssertionError(f"not plain: {kind}")


def _enumeration(kind: t.Type) -> str:
    """The enumeration that a member holds as a number."""
    match kind:
        case t.Enumeration(name=name):
            return short(name)
        case t.Sequence(item):
            return _enumeration(item)
        case _:
            return ""


def comment(text: str, indent: int = 4) -> Iterator[str]:
    for line in textwrap.wrap(spaced(text), WIDTH - indent - 3, break_long_words=False, break_on_hyphens=False):
        yield f"// {line}".rstrip("\\ ")  # a backslash would make the next line part of the comment


# -- names -----------------------------------------------------------------------------

_KEYWORDS = frozenset(
    re.findall(
        r"\w+",
        """
    abstract alias any attribute bitfield bitmask bitset boolean case char component connector const consumes context
    custom default double emits enum eventtype exception factory false finder fixed float getraises home import in
    inout int16 int32 int64 int8 interface local long manages map mirrorport module multiple native object octet oneway
    out port porttype primarykey private provides public publishes raises readonly sequence setraises short string
    struct supports switch true truncatable typedef typeid typename typeprefix uint16 uint32 uint64 uint8 union
    unsigned uses valuebase valuetype void wchar wstring
    """,
    )
)
"""Keywords of IDL 4.2, in lower case: names that differ only in case are reserved, too."""


def _escaped(name: str) -> str:
    """A name as IDL spells it: a leading underscore escapes it and is not part of it."""
    return f"_{name}" if name.lower() in _KEYWORDS or name.startswith("_") else name


def _notes(kinds: Sequence[t.Struct | t.Enumeration], twice: set[str]) -> Iterator[str]:
    """Comments about names that the contract allows, but compilers of IDL may reject."""
    same = {short(kind.name) for kind in kinds if kind.name in twice}
    alike: set[str] = set()
    scopes: dict[str, list[str]] = {}
    for kind in kinds:
        scopes.setdefault(module_of(kind.name), [module_of(kind.name)]).append(short(kind.name))
        inside = kind.fields if isinstance(kind, t.Struct) else ()
        members = [field.name for field in inside] or [member for member, _ in getattr(kind, "members", ())]
        scopes[kind.name] = [short(kind.name), *members]
    same |= {short(kind.name) for kind in kinds if short(kind.name).lower() == "final"}  # as the annotation is
    for scope in scopes.values():
        same |= {name for name, number in Counter(scope).items() if number > 1}
        cases = Counter(name.lower() for name in set(scope))
        alike |= {name for name in scope if cases[name.lower()] > 1}
    for names, what in ((alike, _ALIKE), (same, _SAME)):
        if names:
            yield from comment(f"{what}: {', '.join(sorted(names))}.", 0)


_ALIKE = "Names that differ only in case, which idlc accepts with -f case-sensitive and other compilers may reject"
_SAME = "Names that are defined twice in one scope, which IDL does not allow"
