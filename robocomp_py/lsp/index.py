"""Maps words to the definitions that they name, and back, across files. Made for each request."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path

from ..dsl.innermodel.check import ENDING, is_root
from ..dsl.source import Name, Source, Span
from ..dsl.workspace import SHIPPED
from . import elements
from .outline import Kind, Link, Outline, Symbol, Use, outline
from .project import Project, real, without_mark

_COMMON = SHIPPED / "CommonBehavior.idsl"
_ANY_CASE = (Kind.COMPONENT,)
"""Kinds whose names ignore case."""


@dataclass(frozen=True, slots=True)
class Found:
    """A word and the symbol that it names, and its use if it is not the definition."""

    name: Name
    symbols: tuple[Symbol, ...]
    use: Use | None = None


class Index:
    def __init__(self, project: Project) -> None:
        self.project = project
        self._workspace = project.workspace()
        self._outlines: dict[str, Outline | None] = {}
        self._visible: dict[str, dict[str, list[Symbol]]] = {}
        self._texts: dict[str, str] = {}
        self._closures: dict[str, list[Outline]] = {}
        self._targets: dict[Link, Path | None] = {}

    def outline(self, path: Path) -> Outline | None:
        """What a file defines and uses; None if it cannot be read."""
        key = real(path)
        if key not in self._outlines:
            made = self._outlines[key] = self._made_outline(path)
            if made:
                self.project.last_outlines[key] = made
        return self._outlines[key]

    def _made_outline(self, path: Path) -> Outline | None:
        if path.suffix.lower() == ENDING:
            text = without_mark(self.project.text(path))
            return elements.outline(Source(path, text)) if is_root(text) else None
        model = self._workspace.model(path)
        return self.project.remembered(outline, path, model) if model else None

    def target(self, link: Link) -> Path | None:
        """The file that a link leads to, if it exists."""
        if link not in self._targets:
            self._targets[link] = self._find_target(link)
        return self._targets[link]

    def _find_target(self, link: Link) -> Path | None:
        source = link.name.span.source
        if link.ending:
            return self._workspace.find(link.name.text, source.path, link.ending)
        try:
            path = source.path.parent / link.name.text
            return path if path.is_file() else None
        except (OSError, ValueError):
            return None

    def search_path(self, importing: Path) -> list[Path]:
        return self._workspace.search_path(importing)

    # What a file sees.

    def visible(self, path: Path) -> Iterator[Symbol]:
        """All symbols that can be named in a file: its own, and those of its direct and indirect imports."""
        for symbols in self._seen_from(path).values():
            yield from symbols

    def _seen_from(self, path: Path) -> dict[str, list[Symbol]]:
        """By name in lower case."""
        key = real(path)
        if key not in self._visible:
            found: dict[str, list[Symbol]] = {}
            for each in self.closure(path):
                for symbol in each.walk():
                    found.setdefault(symbol.name.text.lower(), []).append(symbol)
            self._visible[key] = found
        return self._visible[key]

    def closure(self, path: Path) -> list[Outline]:
        """A file, and its direct and indirect imports."""
        key = real(path)
        if key not in self._closures:
            self._closures[key] = self._close(path)
        return self._closures[key]

    def _close(self, path: Path) -> list[Outline]:
        done: dict[str, Outline] = {}
        waiting = [path]
        while waiting:
            each = waiting.pop(0)
            key, made = real(each), self.outline(each) or self.project.last_outlines.get(real(each))
            if key in done or made is None:
                continue
            done[key] = made
            waiting += [target for link in made.links if link.ending and (target := self.target(link))]
        if path.suffix.lower() == ".cdsl" and (common := self.outline(_COMMON)):
            done.setdefault(real(_COMMON), common)  # every component knows it
        return list(done.values())

    def files_that_need(self, home: Path) -> list[Path]:
        """The component models of the project that need a file directly or indirectly."""
        found: dict[Path, None] = {}
        for path in self.project.files():
            made = self.outline(path) if path.suffix.lower() == ".cdsl" else None
            for link in made.links if made else ():
                target = self.target(link)
                if target and any(real(each.source.path) == real(home) for each in self.closure(target)):
                    found[path] = None
        return list(found)

    def resolve(self, use: Use) -> list[Symbol]:
        """The symbols that a use may name; several only if the file has errors."""
        seen = self._seen_from(use.name.span.source.path).get(use.name.text.lower(), [])
        return [
            each
            for each in seen
            if each.kind in use.kinds
            and (use.within is None or use.within == each.within)
            and (not use.owner or use.owner == each.within.rpartition("::")[2])
            and (each.kind in _ANY_CASE or each.name.text == use.name.text)
        ]

    # At a place.

    def at(self, path: Path, offset: int) -> Found | None:
        """The word at a place, if it names something."""
        made = self.outline(path)
        if made is None:
            return None
        named = [Found(each.name, (each,)) for each in made.walk() if each.name.span.touches(offset)]
        used = [each for each in made.uses if each.name.span.touches(offset)]
        named += [Found(each.name, tuple(symbols), each) for each in used if (symbols := self.resolve(each))]
        return named[0] if named else None

    def elsewhere(self, path: Path, offset: int) -> list[Symbol]:
        """The symbols that the word at a place names; for a word that defines one and uses another, the used one."""
        made = self.outline(path)
        used = [each for each in made.uses if each.name.span.touches(offset)] if made else []
        symbols = [symbol for use in used for symbol in self.resolve(use)]
        found = None if symbols else self.at(path, offset)
        return symbols or (list(found.symbols) if found else [])

    def occurrences(self, path: Path, symbols: Collection[Symbol]) -> list[Span]:
        """The places where a file names any of these."""
        made = self.outline(path)
        if made is None:
            return []
        spans = [each.name.span for each in made.walk() if each in symbols]
        spans += [use.name.span for use in made.uses if any(each in symbols for each in self.resolve(use))]
        return list(dict.fromkeys(spans))

    def link_at(self, path: Path, offset: int) -> Link | None:
        made = self.outline(path)
        return next((each for each in made.links if each.name.span.touches(offset)), None) if made else None

    # Everywhere.

    def uses_of(self, symbol: Symbol) -> list[Use]:
        """The uses of a symbol in all files of the project."""
        word = symbol.name.text.lower()
        found = []
        for path in self.project.files():
            if word in self._text_of(path):
                made = self.outline(path)
                for use in made.uses if made else ():
                    if use.name.text.lower() == word and symbol in self.resolve(use):
                        found.append(use)
        return found

    def seeing(self, symbol: Symbol) -> list[Path]:
        """The file that defines a symbol, and the files that import it."""
        home = real(symbol.name.span.source.path)
        return [each for each in self.project.files() if any(real(o.source.path) == home for o in self.closure(each))]

    def symbols(self) -> Iterator[Symbol]:
        """All symbols that the files of the project define."""
        for path in self.project.files():
            made = self.outline(path)
            if made:
                yield from made.walk()

    def unused_imports(self, path: Path) -> list[Link]:
        """Imports of interfaces and components of which the file uses no definition."""
        made = self.outline(path)
        if made is None or path.suffix.lower() == ".pdsl":
            return []
        named = {(use.within, use.name.text.lower()) for use in made.uses}
        imports = [(link, self.target(link)) for link in made.links if link.ending]
        return [link for link, target in imports if target and not self._brings(target, named)]

    def _brings(self, path: Path, named: set[tuple[str | None, str]]) -> bool:
        """Whether a file, or one that it imports, defines any of these names, within a given owner if one is given."""
        symbols = (symbol for each in self.closure(path) for symbol in each.walk())
        return any(
            {(symbol.within, name), (None, name)} & named for symbol in symbols if (name := symbol.name.text.lower())
        )

    def _text_of(self, path: Path) -> str:
        key = real(path)
        if key not in self._texts:
            try:
                self._texts[key] = self.project.read(path).decode("latin-1").lower()
            except (OSError, ValueError):
                self._texts[key] = ""
        return self._texts[key]
