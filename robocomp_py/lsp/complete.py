"""Completion: keywords that the grammar allows at a place, and names that make sense there.

The text before the place is read word by word, because a text that is being written is rarely valid.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path

from .. import installed
from ..contract.goal import POLICIES
from ..contract.interface import Verb
from ..contract.qos import Liveliness
from ..dsl.cdsl.check import OPTIONS
from ..dsl.cdsl.model import SECONDS
from ..dsl.cdsl.qos import KNOWN
from ..dsl.comments import find_comments
from ..dsl.ddsl.clauses import ClauseType, Refers, beginning
from ..dsl.ddsl.scope import meanings
from ..dsl.idsl.check import BUILTIN
from ..dsl.source import Source, Span
from ..dsl.syntax import Grammar
from ..dsl.workspace import ENDINGS
from .edits import Edit, add_import
from .fixes import relative
from .hover import POLICY_WORDS
from .index import Index
from .outline import VALUE_TYPES, Kind, Symbol
from .project import real

_MOST_FILES = 200
"""The most files that are searched for definitions that could be imported."""

_WORDS = re.compile(r'"[^"\n]*"?|\w+|::|\S')


@dataclass(frozen=True)
class Candidate:
    """A proposal. `kind` is that of a symbol, or `keyword`, `word`, `file`."""

    label: str
    kind: str
    detail: str = ""
    doc: str = ""
    text: str = ""
    """The inserted text, if it is not the label."""
    also: tuple[Edit, ...] = ()
    """Further changes, such as an import."""
    rank: int = 1
    """Smaller is more likely."""
    over: Span | None = None
    """The text that it replaces, if that is not just the word before the cursor."""


@dataclass
class _Block:
    """An open block: the words before its brace, and those of its unfinished statement."""

    head: list[str]
    words: list[str] = field(default_factory=list)


_MARKS = (["[", "records", "]"], ["[", "confirm", "]"])


@dataclass
class _Place:
    index: Index
    source: Source
    offset: int
    blocks: list[_Block]
    """Outermost first; the first is the file."""

    @property
    def path(self) -> Path:
        return self.source.path

    @property
    def words(self) -> list[str]:
        """The words of the statement up to the cursor; without `[records]` and `[confirm]`."""
        words = self.blocks[-1].words
        for mark in _MARKS:
            at = next((place for place in range(len(words)) if words[place : place + 3] == mark), None)
            words = words if at is None else words[:at] + words[at + 3 :]
        return words

    @property
    def first(self) -> str:
        return self.words[0] if self.words else ""

    @property
    def last(self) -> str:
        return self.words[-1] if self.words else ""

    @property
    def heads(self) -> list[str]:
        """The first word of each block around."""
        return [block.head[0].lower() if block.head else "" for block in self.blocks[1:]]


def complete(index: Index, path: Path, text: str, offset: int) -> list[Candidate]:
    """All proposals at an offset, which may be within a word."""
    before = re.sub(r"\w*$", "", text[:offset])
    comments = find_comments(Source(path, text[:offset]))
    if comments.spans and comments.spans[-1].end == offset and not comments.spans[-1].text.endswith("*/"):
        return []
    place = _Place(index, Source(path, text), offset, _blocks(comments.bare[: len(before)]))
    language = path.suffix.lower()
    if comments.bare.rpartition("\n")[2].count('"') % 2 == 1:
        place.blocks[-1].words = place.words[:-1] if place.last.startswith('"') else place.words
        begun = place.source.span(comments.bare.rindex('"') + 1, offset)
        return [replace(each, over=begun) for each in _files(place)]
    keywords = Grammar(language.removeprefix(".")).words_behind(Source(path, before)) if language in ENDINGS else []
    names = _NAMES[language](place) if language in _NAMES else ()
    found = [*names, *(Candidate(word, "keyword", rank=2) for word in keywords if _fits(word, place))]
    return list({each.label: each for each in reversed(found)}.values())[::-1]


_HANDLED = (Verb.IMPLEMENTS.lower(), Verb.SUBSCRIBES.lower())
_PROVIDED = (Verb.IMPLEMENTS.lower(), Verb.PUBLISHES.lower())


def _fits(keyword: str, place: _Place) -> bool:
    """Whether a keyword that the grammar allows makes sense."""
    match place.path.suffix.lower(), keyword:
        case ".cdsl", "each":
            return place.first.lower() in _PROVIDED
        case ".cdsl", "concurrent":
            return place.first.lower() in _HANDLED
        case ".idsl", "feedback":
            return "action" in place.words
        case _:
            return True


def _blocks(text: str) -> list[_Block]:
    blocks = [_Block([])]
    for found in _WORDS.finditer(text):
        word = found[0]
        if word == "{":
            blocks.append(_Block(blocks[-1].words))
            blocks[-2].words = []
        elif word == "}" and len(blocks) > 1:
            blocks.pop()
            blocks[-1].words = []
        elif word == ";":
            blocks[-1].words = []
        else:
            blocks[-1].words.append(word)
    return blocks


# Files.


def _files(place: _Place) -> Iterator[Candidate]:
    """The files that a text in quotes may name."""
    word = place.last.lower()
    endings = {"params": (".pdsl",), "statemachine": (".smdsl", ".scxml"), "config": (".toml",)}
    if word == "import":
        yield from _importable(place)
    elif word in endings:
        folder = place.path.parent
        below = "*/etc/" if word == "config" else ""
        for path in sorted(each for end in endings[word] for each in folder.glob(f"{below}*{end}")):
            yield Candidate(path.relative_to(folder).as_posix(), "file")


def _importable(place: _Place) -> Iterator[Candidate]:
    ending = {".idsl": ".idsl", ".cdsl": ".idsl", ".ddsl": ".cdsl", ".pdsl": ".pdsl"}.get(place.path.suffix.lower())
    for name, path in _importable_files(place, ending).items() if ending else ():
        yield Candidate(name, "file", str(path.parent))


def _importable_files(place: _Place, ending: str) -> dict[str, Path]:
    """The forms of imports: names that are found on the search path, and paths of other files of the project."""
    found: dict[str, Path] = {}
    for folder in place.index.search_path(place.path):
        for path in sorted(folder.glob(f"*{ending}")):
            found.setdefault(path.name, path)
    known = {real(each) for each in found.values()}
    for path in place.index.project.files():
        if path.suffix.lower() == ending and real(path) not in known:
            found[relative(path, place.path)] = path
    return {name: path for name, path in found.items() if real(path) != real(place.path)}


# Names, by language.


def _of(symbols: Iterable[Symbol], *kinds: Kind) -> list[Symbol]:
    return [each for each in symbols if each.kind in kinds]


def _symbol(symbol: Symbol, rank: int = 0, text: str = "", also: tuple[Edit, ...] = ()) -> Candidate:
    return Candidate(symbol.name.text, symbol.kind, symbol.detail, symbol.doc, text, also, rank)


def _in_idsl(place: _Place) -> Iterator[Candidate]:
    wanted = _wanted_in_idsl(place)
    if not wanted:
        return
    modules = [block.head[1] for block in place.blocks[1:] if block.head[:1] == ["module"] and len(block.head) > 1]
    module = modules[0] if modules else ""
    if place.last == "::":
        given = place.words[-2] if len(place.words) > 1 else ""
        yield from (_symbol(each) for each in _of(place.index.visible(place.path), *wanted) if each.within == given)
        return
    if Kind.STRUCT in wanted:
        yield from (Candidate(name, "word", f"{kind}", rank=1) for name, kind in BUILTIN.items())
        if _is_in(place, "interface") and place.last in ("", "]", "idempotent"):
            yield Candidate("void", "word")
    seen = set()
    for each in _of(place.index.visible(place.path), *wanted):
        seen.add(each.qualified)
        own = each.within == module
        yield _symbol(each) if own else _symbol(each, 1, text=each.qualified)
    for name, path in islice(_importable_files(place, ".idsl").items(), _MOST_FILES):
        made = place.index.outline(path)
        for each in _of(made.walk(), *wanted) if made else ():
            if each.qualified not in seen and each.within != module:
                also = (add_import(place.source, name),)
                yield replace(_symbol(each, 3, each.qualified, also), detail=f'import "{name}"')


def _wanted_in_idsl(place: _Place) -> tuple[Kind, ...]:
    """The kinds of names that can come next."""
    words, first = place.words, place.first
    if words and words[-1] == "::":
        words = words[:-2]
    last = words[-1] if words else ""
    if _is_in(place, "interface"):
        if "throws" in words:
            return (Kind.EXCEPTION,) if last in ("throws", ",") else ()
        opened = words.count("(") > words.count(")")
        if opened:
            return VALUE_TYPES if last in ("(", ",", "out", "<") else ()
        return VALUE_TYPES if last in ("", "]", "idempotent", "<") else ()
    if _is_in(place, "struct") or _is_in(place, "exception"):
        if last == "=":
            return (Kind.ENUMERATOR,)
        return VALUE_TYPES if last in ("", "<") else ()
    if first in ("sequence", "dictionary"):
        return VALUE_TYPES if last in ("<", ",") and ">" not in words else ()
    if first == "const":
        return VALUE_TYPES if last == "const" else (Kind.ENUMERATOR,) if last == "=" else ()
    if last == "extends" or (last == "," and "extends" in words):
        return (Kind.INTERFACE,) if first == "interface" else (Kind.EXCEPTION,)
    return ()


def _is_in(place: _Place, kind: str) -> bool:
    return place.heads[-1:] == [kind]


def _in_cdsl(place: _Place) -> Iterator[Candidate]:
    words = [word.lower() for word in place.words]
    last = words[-1] if words else ""
    verbs = {verb.value.lower() for verb in Verb}
    inside = _open_call(words)
    if inside == "qos":
        yield from _words_of_qos(last)
    elif inside and words[0] == "implements" and last not in ("(", ","):
        yield from (Candidate(name, "word", POLICY_WORDS[name]) for name in POLICIES)
    elif inside:
        yield from (Candidate(name, "word", "middleware") for name in installed.transports() if last == "(")
        if words[0] == "implements":
            yield from _actions(place, inside)
    elif words and words[0] in verbs and last in (words[0], ","):
        yield from _interfaces(place)
    elif last == "language":
        yield Candidate("python", "word")
    elif words[:1] == ["options"] and last in ("options", ","):
        yield from (Candidate(option, "word") for option in OPTIONS)
    elif (words[:1] == ["period"] and len(words) > 1) or (words[:1] == ["timer"] and len(words) > 2):
        yield from (Candidate(unit, "word") for unit in SECONDS)


def _actions(place: _Place, interface: str) -> Iterator[Candidate]:
    """The actions of an interface, for which a policy may be given."""
    for each in _of(place.index.visible(place.path), Kind.INTERFACE):
        if each.name.text.lower() == interface:
            for operation in each.children:
                if operation.detail.startswith("[action]"):
                    yield Candidate(operation.name.text, operation.kind, operation.detail, operation.doc, rank=0)


def _open_call(words: list[str]) -> str:
    """The word before an open parenthesis."""
    depth = 0
    for at in range(len(words) - 1, -1, -1):
        depth += {")": 1, "(": -1}.get(words[at], 0)
        if depth < 0:
            return words[at - 1] if at else ""
    return ""


def _words_of_qos(last: str) -> Iterator[Candidate]:
    return (Candidate(str(word), "word") for word in (Liveliness if last == "liveliness" else KNOWN))


def _interfaces(place: _Place) -> Iterator[Candidate]:
    """Imported interfaces, then those that could be imported, whose files are not read."""
    seen = set()
    for each in _of(place.index.visible(place.path), Kind.INTERFACE):
        seen.add(each.name.text)
        yield _symbol(each)
    for written, path in _importable_files(place, ".idsl").items():
        for name in _interfaces_of(place, path):
            if name not in seen:
                seen.add(name)
                also = (add_import(place.source, written),)
                yield Candidate(name, Kind.INTERFACE, f'import "{written}"', also=also, rank=1)


def _interfaces_of(place: _Place, path: Path) -> list[str]:
    """The interfaces in a file of the project; for other files, a name derived from the file's."""
    if not place.index.project.owns(path):
        return [path.stem]
    made = place.index.outline(path)
    return [each.name.text for each in _of(made.walk(), Kind.INTERFACE)] if made else []


def _in_ddsl(place: _Place) -> Iterator[Candidate]:
    words = place.words
    last = words[-1] if words else ""
    symbols = list(place.index.visible(place.path))
    clause = beginning(place.first)
    if words[:1] == ["offers"]:
        if last in (":", ","):
            yield from _offerable(place, symbols)
    elif last == ":" or (last == "Component" and len(words) == 1):
        yield from (_symbol(each) for each in _of(symbols, Kind.COMPONENT))
    elif clause and clause.settings and _open_call(words):
        yield from _settings(clause, words)
    elif clause and clause.refers is Refers.OPERATION:
        yield from _allowable(place, symbols)
    elif clause and clause.refers and (len(words) == 1 or (clause.many and last == ",")):
        yield from _referable(place, clause.refers, symbols)
    elif last == "from":
        yield from _providers(place, symbols)
    elif len(words) == 1 and last in ("requires", "subscribesTo"):
        yield from _wireable(place, last, symbols)
    elif last == "middleware":
        yield from _referable(place, Refers.MIDDLEWARE, symbols)
    elif last == "process":
        named = re.findall(r"\bprocess\s+([A-Za-z_]\w*)\s*;", find_comments(place.source).bare)
        yield from (Candidate(name, "word", "process") for name in dict.fromkeys(named))
    elif place.first == "qos" and _open_call(words):
        yield from _words_of_qos(last)
    elif place.first == "qos" and last in ("qos", *_TOPIC_VERBS):
        for verb in _TOPIC_VERBS if last == "qos" else (last,):
            yield from _wireable(place, verb, symbols)


def _settings(clause: ClauseType, words: list[str]) -> Iterator[Candidate]:
    """What can come next between the parentheses of a clause: a setting that is not there yet, or a value of one."""
    proposed = clause.values.get(words[-1], {})
    if words[-1] in ("(", ","):
        proposed = {name: text for name, text in clause.settings.items() if name not in words}
    yield from (Candidate(word, "word", doc=text) for word, text in proposed.items())


def _referable(place: _Place, what: Refers, symbols: list[Symbol]) -> Iterator[Candidate]:
    """What the names in a clause may stand for."""
    match what:
        case Refers.INSTANCE:
            own = place.blocks[-1].head[1] if place.heads[-1:] == ["component"] else ""
            yield from (each for each in _instances(place, symbols, Kind.INSTANCE) if each.label != own)
        case Refers.HOST:
            yield from (_symbol(each) for each in _of(symbols, Kind.HOST) if place.heads[-1:] != ["deployment"])
        case Refers.MIDDLEWARE:
            yield from (Candidate(name, "word", "middleware") for name in installed.transports())
        case Refers.OPERATION:
            yield from _allowable(place, symbols)


def _allowable(place: _Place, symbols: list[Symbol]) -> Iterator[Candidate]:
    """What an agent may be allowed to do: what can follow the written part of a path."""
    written = "".join(" ".join(place.words[1:]).rpartition(",")[2].split())
    if written and not written.endswith("/"):
        return
    inside = place.heads[-1:] == ["component"]
    for prefix, ports in [("", _ports(place, symbols))] if inside else _served(symbols):
        for port in ports:
            verb, interface, *each = port.split()
            if verb not in (Verb.IMPLEMENTS, Verb.SUBSCRIBES) or each:
                continue
            for path, symbol in _paths(f"{prefix}{interface}", interface, symbols):
                if path.startswith(written):
                    yield replace(_symbol(symbol), label=path.removeprefix(written))


def _served(symbols: list[Symbol]) -> Iterator[tuple[str, list[str]]]:
    """The ports of each instance of the network, with the beginning of their paths."""
    components = {each.name.text.lower(): each for each in _of(symbols, Kind.COMPONENT)}
    for each in _of(symbols, Kind.INSTANCE):
        component = components.get(each.detail.lower())
        path = "/".join((*each.within.split("::")[1:], each.name.text))
        yield f"{path}/", list(filter(None, component.detail.split(", "))) if component else []


def _paths(port: str, interface: str, symbols: list[Symbol]) -> Iterator[tuple[str, Symbol]]:
    """The paths of an interface and of its operations."""
    for each in _of(symbols, Kind.INTERFACE):
        if each.name.text == interface:
            yield port, each
            yield from ((f"{port}/{one.name}", one) for one in each.children)


_TOPIC_VERBS = tuple(str(verb) for verb in Verb if verb.is_topic)


def _wireable(place: _Place, verb: str, symbols: list[Symbol]) -> Iterator[Candidate]:
    """The interfaces that the component of this instance uses with a verb."""
    for port in _ports(place, symbols):
        used, interface, *_ = port.split()
        if used == verb:
            yield Candidate(interface, Kind.INTERFACE, port, rank=0)


def _offerable(place: _Place, symbols: list[Symbol]) -> Iterator[Candidate]:
    """The interfaces that the component of this instance provides by named instances."""
    for port in _ports(place, symbols):
        _, interface, *each = port.split()
        if each and interface not in place.words:
            yield Candidate(interface, Kind.INTERFACE, port, rank=0)


def _ports(place: _Place, symbols: list[Symbol]) -> Iterator[str]:
    """The ports of the component of this instance: `implements Laser each`."""
    head = place.blocks[-1].head
    kind = (head[3] if head[2:3] == [":"] and len(head) > 3 else head[1] if len(head) > 1 else "").lower()
    for component in _of(symbols, Kind.COMPONENT):
        if component.name.text.lower() == kind:
            yield from filter(None, component.detail.split(", "))


def _providers(place: _Place, symbols: list[Symbol]) -> Iterator[Candidate]:
    """Instances and named instances; first those that provide the interface."""
    verb = "implements" if place.first == "requires" else "publishes"
    interface = place.words[1].rstrip("0123456789") if len(place.words) > 2 else ""
    components = _of(symbols, Kind.COMPONENT)
    offering = {each.name.text.lower() for each in components if f"{verb} {interface}" in each.detail.split(", ")}
    for each in _instances(place, symbols, Kind.INSTANCE, Kind.NAMED):
        provides = interface in each.detail.split(", ") if each.kind == Kind.NAMED else each.detail.lower() in offering
        yield replace(each, rank=0 if provides else 3)


def _instances(place: _Place, symbols: list[Symbol], *kinds: Kind) -> Iterator[Candidate]:
    """All of the network, as they are named from here."""
    systems = tuple(block.head[1] for block in place.blocks if block.head[:1] == ["System"] and len(block.head) > 1)
    names = {"/".join((*each.within.split("::")[1:], each.name.text)): each for each in _of(symbols, *kinds)}
    for whole, each in names.items():
        parts = whole.split("/")
        ways = ("/".join(parts[-count:]) for count in range(1, len(parts) + 1))
        written = next((way for way in ways if meanings(way, systems, names)[:1] == [whole]), f"/{whole}")
        yield replace(_symbol(each), label=written)


def _in_pdsl(place: _Place) -> Iterator[Candidate]:
    """The choices of a parameter, for its default."""
    if place.last == "enum":
        behind = re.match(r"\w*\s*\{([^{}]*)\}", place.source.text[place.offset :])
        for choice in re.findall(r'"[^"\n]*"|[\w.+-]+', behind[1]) if behind else ():
            yield Candidate(choice, "word")


def _in_smdsl(place: _Place) -> Iterator[Candidate]:
    if "transitions" in place.heads[-1:] or place.last in (":", "=>"):
        yield from (_symbol(each) for each in _of(place.index.visible(place.path), Kind.STATE))


_NAMES: dict[str, Callable[[_Place], Iterator[Candidate]]] = {
    ".idsl": _in_idsl,
    ".cdsl": _in_cdsl,
    ".ddsl": _in_ddsl,
    ".pdsl": _in_pdsl,
    ".smdsl": _in_smdsl,
}
