"""Maps the files that processes name to their places on another host."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import Path

from .plan import Process

Places = Mapping[Path, str]
"""Maps local files and folders to their names on the other host."""


def places(processes: Iterable[Process], below: str) -> dict[Path, str]:
    """A place in the folder `below` for each file that these processes name. It keeps its name if that is free.

    Files inside a named folder keep their places in it. The same processes always get the same places.
    """
    paths = dict.fromkeys(path for process in processes for path in process.files)
    found: dict[Path, str] = {}
    taken: set[str] = set()
    for path in sorted(paths, key=lambda path: len(path.parts)):
        around = next((folder for folder in path.parents if folder in found), None)
        if around:
            found[path] = f"{found[around]}/{path.relative_to(around).as_posix()}"
        else:
            name = _free(path.name, taken)
            taken.add(name.lower())
            found[path] = f"{below}/{name}"
    return found


def relocate(process: Process, moved: Places, python: str) -> tuple[str, ...]:
    """The command of a process on the other host, with the interpreter `python`."""
    names = {str(path): place for path, place in moved.items()}
    first, *rest = (names.get(word, word) for word in process.command)
    return (first if process.is_program else python, *rest)


def _free(name: str, taken: set[str]) -> str:
    """This name, or a similar one that is not taken, and is valid on every file system."""
    stem, dot, ending = name.partition(".")
    stem = re.sub(r"\W", "_", stem) or "_"  # a component's folder is a package
    name = f"{stem}{dot}{re.sub(r'[^A-Za-z0-9.]', '_', ending)}"
    number = 2
    while name.lower() in taken:
        name, number = f"{stem}{number}{dot}{ending}", number + 1
    return name
