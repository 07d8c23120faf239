"""Files that are right, and mistakes as people make them in one of them."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

Place = tuple[int, int]
"""The offsets of the first character, and of the one behind the last."""


@dataclass(frozen=True)
class Seed:
    """One mistake: what is written instead of what, in which file, and the code by which it must be told.

    What is to be underlined stands in «…», once in all that is written; a change that only marks it keeps the text.
    """

    name: str
    code: str
    file: str
    changes: Mapping[str, str]
    severity: str = "error"


def sow(right: Mapping[str, str], seeds: Sequence[Seed]) -> tuple[dict[str, str], list[Place]]:
    """The files with these mistakes, and from where to where each stands in its file."""
    files = dict(right)
    for number, seed in enumerate(seeds):
        if sum(after.count("«") for after in seed.changes.values()) != 1:
            raise ValueError(f"{seed.name}: one place is to be marked")
        for before, after in seed.changes.items():
            if files[seed.file].count(before) != 1:
                raise ValueError(f"{seed.name}: {before!r} does not stand once in {seed.file}")
            marked = after.replace("«", f"«{number}:").replace("»", f":{number}»")
            files[seed.file] = files[seed.file].replace(before, marked)
    places = [_place(files[seed.file], number) for number, seed in enumerate(seeds)]
    return {name: _bare(text) for name, text in files.items()}, places


def _place(text: str, number: int) -> Place:
    before, _, rest = text.partition(f"«{number}:")
    marked = rest.partition(f":{number}»")[0]
    start = len(_bare(before))
    return start, start + len(_bare(marked))


def _bare(text: str) -> str:
    return re.sub(r"«\d+:|:\d+»", "", text)
