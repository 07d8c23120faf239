"""How parts of a network look in a notebook or at a prompt."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from html import escape


def lines(name: str, rows: Iterable[tuple[str, str]]) -> Iterator[str]:
    """Names and what they are, one a line."""
    listed = list(rows)
    width = max((len(each) for each, _ in listed), default=0)
    yield f"{name}:" if listed else f"{name}: nothing is here now"
    for each, text in listed:
        yield f"  {each:{width}}  {text}".rstrip()


def table(name: str, rows: Iterable[tuple[str, str]]) -> str:
    """The same as HTML. Names come from outside, so they are escaped."""
    body = "".join(f"<tr><td><code>{escape(each)}</code></td><td>{escape(text)}</td></tr>" for each, text in rows)
    return f"<b>{escape(name)}</b><table>{body}</table>"
