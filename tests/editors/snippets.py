"""Snippets as an editor expands them, if a user keeps what is proposed."""

from __future__ import annotations

import re

_PART = re.compile(r"\\(?P<plain>[$}\\])|\$(?:(?P<number>\d+)|\{(?P<held>\w+)(?P<rest>[}:|]))")


def expand(body: str, file: str, choice: int = 0) -> str:
    """A snippet's text in a file of this name. Of what is to be chosen from, the given one, or the last there is."""
    text, end = _expand(body, 0, {"TM_FILENAME_BASE": file}, choice, nested=False)
    assert end == len(body)
    return text


def most_choices(body: str) -> int:
    """How many expansions show every choice at least once."""
    return max([1, *(len(each.split(",")) for each in re.findall(r"\$\{\d+\|(.*?)\|\}", body))])


def _expand(body: str, at: int, known: dict[str, str], choice: int, *, nested: bool) -> tuple[str, int]:
    text = ""
    while at < len(body) and not (nested and body[at] == "}"):
        found = _PART.match(body, at)
        if found is None:
            text, at = text + body[at], at + 1
        elif found["plain"]:
            text, at = text + found["plain"], found.end()
        elif found["number"]:
            text, at = text + known.get(found["number"], ""), found.end()
        else:
            value, at = _held(body, found, known, choice)
            text += known.setdefault(found["held"], value)
    return text, at


def _held(body: str, found: re.Match[str], known: dict[str, str], choice: int) -> tuple[str, int]:
    """What `${…}` proposes, and where it ends."""
    at = found.end()
    match found["rest"]:
        case "}":
            return known[found["held"]], at
        case "|":
            end = body.index("|}", at)
            choices = body[at:end].split(",")
            return choices[min(choice, len(choices) - 1)], end + 2
        case _:
            text, end = _expand(body, at, known, choice, nested=True)
            return text, end + 1
