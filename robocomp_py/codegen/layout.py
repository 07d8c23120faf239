"""Lays out generated lines as formatters do, within their line length."""

from __future__ import annotations

import json
import re
import shlex
import textwrap
from collections.abc import Sequence
from typing import Any

from ..printable import spaced

WIDTH = 88
"""Default line length of formatters."""


def call(function: str, arguments: Sequence[str], indent: int, around: int = 0) -> str:
    """A call on one line, or with one argument per line if it would be too long with `around` more characters."""
    line = f"{function}({', '.join(arguments)})"
    if indent + len(line) + around <= WIDTH and "\n" not in line:
        return line
    margin = " " * indent
    inner = "".join(f"{margin}    {each},\n" for each in arguments)
    return f"{function}(\n{inner}{margin})"


def tuple_of(items: Sequence[str], before: int, indent: int = 4) -> str:
    """A tuple with one item per line; a single item on one line if it fits after `before` characters."""
    line = f"({', '.join(items)},)" if items else "()"
    if not items or (len(items) == 1 and before + len(line) + 1 <= WIDTH and "\n" not in line):
        return line
    margin = " " * indent
    inner = "".join(f"{margin}    {each},\n" for each in items)
    return f"(\n{inner}{margin})"


def signature(name: str, arguments: Sequence[str], returned: str, indent: int = 4) -> str:
    """A `def` line, or one argument per line if it would be too long."""
    line = f"def {name}({', '.join(arguments)}) -> {returned}:"
    if indent + len(line) <= WIDTH:
        return line
    margin = " " * indent
    inner = "".join(f"{margin}    {each},\n" for each in arguments)
    return f"def {name}(\n{inner}{margin}) -> {spread(returned, indent, 5, 1)}:"


def spread(annotation: str, indent: int, before: int, after: int) -> str:
    """An annotation, on several lines if it is too long with `before` and `after` more characters."""
    head, bracket, rest = annotation.partition("[")
    if not bracket or annotation.startswith('"') or indent + before + len(annotation) + after <= WIDTH:
        return annotation
    items = _top_level(rest[:-1])
    margin, comma = " " * indent, "," if len(items) > 1 else ""
    inner = "".join(f"{margin}    {spread(item, indent + 4, 0, len(comma))}{comma}\n" for item in items)
    return f"{head}[\n{inner}{margin}]"


def assigned(head: str, value: str, indent: int) -> str:
    """`head = value`, with the value in parentheses on its own line if that makes it fit."""
    before = len(head.rpartition("\n")[2]) + (0 if "\n" in head else indent)
    if before + len(f" = {value}") <= WIDTH or indent + 4 + len(value) > WIDTH:
        return f"{head} = {value}"
    margin = " " * indent
    return f"{head} = (\n{margin}    {value}\n{margin})"


def docstring(text: str, indent: int) -> str:
    """A docstring of wrapped paragraphs."""
    quote = '"""'
    safe = spaced(text).replace("\\", "\\\\").replace(quote, "'''").strip()
    safe = f" {safe}" if safe.startswith('"') else safe
    safe = f"{safe} " if safe.endswith('"') else safe
    lines = _wrap_prose((quote + safe).splitlines(), WIDTH - indent)
    lines[0] = lines[0].removeprefix(quote)
    margin = " " * indent
    if len(lines) == 1 and indent + len(lines[0]) + 6 <= WIDTH:
        return f"{quote}{lines[0]}{quote}"
    if len(lines) == 1:  # the closing quotes do not fit: wrap the text so that it has two lines
        lines = _wrap(lines[0], WIDTH - indent - 6)
    body = "\n".join(f"{margin}{line}".rstrip() for line in lines[1:])
    return f"{quote}{lines[0]}\n{body}\n{margin}{quote}".replace(f"\n\n{margin}{quote}", f"\n{margin}{quote}")


def commented(line: str, text: str, indent: int) -> str:
    """A statement with a comment after it or, if that would be too long, above it."""
    words = " ".join(spaced(text).split())
    if not words:
        return line
    if "\n" not in line and indent + len(line) + 4 + len(words) <= WIDTH:
        return f"{line}  # {words}"
    return f"{remark(words, indent)}\n{' ' * indent}{line}"


def remark(text: str, indent: int) -> str:
    """A comment, wrapped."""
    return f"\n{' ' * indent}".join(f"# {line}" for line in _wrap(spaced(text), WIDTH - indent - 2))


def text(value: str, indent: int, around: int) -> str:
    """A string on one line, or on several if it would be too long with `around` more characters."""
    if indent + len(quoted(value)) + around <= WIDTH:
        return quoted(value)
    margin = " " * indent
    if indent + 4 + len(quoted(value)) <= WIDTH:
        return f"(\n{margin}    {quoted(value)}\n{margin})"
    lines = textwrap.wrap(value, WIDTH - indent - 12, break_on_hyphens=False, drop_whitespace=False)
    return "(\n" + "".join(f"{margin}    {quoted(line)}\n" for line in lines) + f"{margin})"


def quoted(value: Any) -> str:
    """A literal that is valid in Python and TOML; strings in double quotes."""
    if not isinstance(value, str):
        return repr(value).replace("e+", "e")
    escaped = json.dumps(value, ensure_ascii=False)
    return "".join(char if char.isprintable() else f"\\U{ord(char):08x}" for char in escaped)


def on_one_line(text: str) -> str:
    """A text without line breaks, such as the name of a file."""
    return spaced(text).replace("\n", " ")


def shell_word(text: str) -> str:
    """A text as one word of a shell command."""
    return shlex.quote(on_one_line(text))


def one_line(text: str, *names: str) -> str:
    """The first paragraph of a documentation on one line. `names` are kept as they are: see `capital`."""
    return capital(" ".join(spaced(text).strip().split("\n\n")[0].split()), *names)


def capital(text: str, *names: str) -> str:
    """The text with a capital first letter, unless it begins with one of these names."""
    found = re.match(r"\w+", text)
    return text if found and found[0] in names else text[:1].upper() + text[1:]


def _wrap_prose(given: Sequence[str], width: int) -> list[str]:
    """Wrap lines. The rest of a long line continues on the next one, unless that begins an item of a list."""
    lines, rest = list[str](), ""
    for line, following in zip(given, [*given[1:], ""], strict=True):
        wrapped = _wrap(f"{rest} {line}".strip(), width) or [""]
        rest = wrapped.pop() if len(wrapped) > 1 and following and not _ITEM.match(following) else ""
        lines += wrapped
    return lines


_ITEM = re.compile(r"\s|[-+*•@\\]|\w+\s*[:=]|\(?\w{1,2}\)|\d+\.|(Returns?|Param)\b")
"""Matches the begin of a line that does not continue the sentence of the line above it."""


def _wrap(text: str, width: int) -> list[str]:
    return textwrap.wrap(text, width, break_long_words=False, break_on_hyphens=False)


def _top_level(text: str) -> list[str]:
    """Split a text at commas outside brackets and strings."""
    parts, depth = [""], 0
    for token in re.findall(r'"(?:[^"\\]|\\.)*"|.', text):
        depth += {"[": 1, "]": -1}.get(token, 0)
        if token == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += token
    return [part.strip() for part in parts]
