"""Whether `rcgen` has nothing to do, told without parsing or generating anything.

A run that leaves everything up to date, and finds nothing wrong, writes a record: digests of the content of

    every file that it read, and the paths at which it looked for one in vain (an import may be shadowed by a new file)
    every file in the generic parts, and which files and folders there are beside them
    all of robocomp_py, the plug-ins, the names and versions of what else is installed, and the environment

The next run compares all of it. If anything differs, or the record is damaged, everything is done as without a record.
Times and sizes of files play no part. The record is in `__pycache__` beside the model, which version control ignores.

Only light modules are imported here: loading the generator takes longer than the comparison.
"""

from __future__ import annotations

import contextlib
import importlib.util
import json
import os
import stat
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from hashlib import blake2b
from pathlib import Path
from typing import Any

from .. import installed
from ..version import __version__

_ABSENT, _SPECIAL = "", "special"
"""Instead of the digest of a file: there is none that can be read; it is no regular file."""

_STAGING = ".rcgen-"
"""How the folders begin that a killed run leaves behind, and that the next one removes."""


@dataclass(frozen=True)
class Request:
    """The arguments of a run that decide what it generates, except for the middleware."""

    models: tuple[Path, ...]
    include: tuple[Path, ...] = ()
    output: Path | None = None

    @property
    def record(self) -> Path:
        """The file of its record."""
        first = self.models[0]
        folder = first if first.is_dir() else first.parent
        return folder / "__pycache__" / f"{first.name or 'folder'}.rcgen"

    def circumstances(self) -> dict[str, Any]:
        """What paths and imports mean."""
        environment = {name: os.environ.get(name) for name in ("ROBOCOMP", "ROBOCOMP_INTERFACES")}
        paths = [list(map(str, each)) for each in (self.models, self.include)]
        return {
            "paths": [*paths, str(self.output)],
            "environment": environment,
            "home": os.path.expanduser("~"),
            "working directory": os.getcwd(),
        }


@dataclass(frozen=True)
class Component:
    """A component that is up to date."""

    name: str
    root: str
    """Its folder, as it is printed."""
    middleware: str
    generic: str
    """The digest of its generic part."""
    files: Sequence[str]
    """The user's files that have to be there: otherwise they are written again."""
    folders: Sequence[str]
    """Those that have to be folders, and no links."""

    def is_there(self) -> bool:
        """Whether its folder holds what it did."""
        try:
            return (
                not any(name.startswith(_STAGING) for name in os.listdir(self.root or "."))
                and all(stat.S_ISREG(os.stat(os.path.join(self.root, each)).st_mode) for each in self.files)
                and all(stat.S_ISDIR(os.lstat(os.path.join(self.root, each)).st_mode) for each in self.folders)
                and together(generic_part(self.root)) == self.generic
            )
        except (OSError, ValueError):
            return False


@dataclass
class Trace:
    """Reads files, and notes what was in them."""

    read_file: Callable[[Path], bytes]
    files: dict[str, tuple[str, str]] = field(default_factory=dict)
    """By path, the digest of a file, and where it really is."""
    listings: dict[str, list[str]] = field(default_factory=dict)
    """By folder, the names of the component models in it."""
    is_steady: bool = True
    """False once a file was read that had changed since it was read before."""

    def read(self, path: Path) -> bytes:
        try:
            data = self.read_file(path)
        except (OSError, ValueError):
            self._note(path, _ABSENT)
            raise
        self._note(path, digest(data) if path.is_file() else _SPECIAL)
        return data

    def note_models_in(self, folder: Path) -> None:
        self.listings[str(folder)] = _models_in(str(folder))

    def _note(self, path: Path, content: str) -> None:
        noted = (content, _Real()(str(path)) if content else "")
        self.is_steady &= content != _SPECIAL and self.files.setdefault(str(path), noted) == noted


def up_to_date(request: Request, made_by: str) -> list[Component] | None:
    """The components of a request, if all of them are up to date and nothing is wrong; None if that is not known.

    `made_by` is what `generator` is.
    """
    try:
        found = _parsed(request.record.read_bytes())
        if found["request"] == request.circumstances() and found["generator"] == made_by and _are_there(found):
            components = [Component(**each) for each in found["components"]]
            return components if all(each.is_there() for each in components) else None
    except (OSError, ValueError, LookupError, TypeError, AttributeError):
        pass  # there is no record, or it is damaged, or a folder is gone
    return None


def _are_there(record: Any) -> bool:
    """Whether a run would read what is recorded."""
    real = _Real()
    files, listings = record["files"].items(), record["listings"].items()
    return all(_digest_of(path) == now and (not now or real(path) == at) for path, (now, at) in files) and all(
        _models_in(folder) == names for folder, names in listings
    )


def remember(request: Request, trace: Trace, components: Sequence[Component], made_by: str) -> None:
    """Write the record of a run that found nothing wrong and left everything up to date.

    `made_by` is what `generator` was before it. A record that cannot be written is left out.
    """
    if not trace.is_steady or made_by != generator():
        return
    record = {
        "request": request.circumstances(),
        "generator": made_by,
        "files": trace.files,
        "listings": trace.listings,
        "components": [asdict(each) for each in components],
    }
    body = json.dumps(record).encode()
    with contextlib.suppress(OSError):
        _replace(request.record, digest(body).encode() + b"\n" + body)


def _replace(path: Path, data: bytes) -> None:
    path.parent.mkdir(exist_ok=True)
    number, new = tempfile.mkstemp(prefix=f"{path.name}.", dir=path.parent)
    try:
        with open(number, "wb") as file:
            file.write(data)
        os.replace(new, path)
    except BaseException:
        os.unlink(new)
        raise


def _parsed(record: bytes) -> Any:
    """Raises ValueError for a damaged record."""
    head, _, body = record.partition(b"\n")
    if head != digest(body).encode():
        raise ValueError("the record is damaged")
    return json.loads(body)


# Content.


def digest(data: bytes) -> str:
    return blake2b(data, digest_size=16).hexdigest()


def generic_part(root: str) -> dict[str, str]:
    """The digests of the files in a component's generic part, by name; "link" for what only leads somewhere."""
    return dict(_contents(os.path.join(root, "generic"), "generic", depth=1))


def together(digests: dict[str, str]) -> str:
    return digest(json.dumps(sorted(digests.items())).encode())


def _contents(folder: str, name: str, depth: int) -> Iterator[tuple[str, str]]:
    with os.scandir(folder) as entries:
        for each in entries:
            inside = f"{name}/{each.name}"
            if each.is_symlink():
                yield inside, "link"
            elif not each.is_dir():
                if not each.name.endswith(".pyc"):
                    yield inside, _digest_of(each.path)
            elif depth:
                yield from _contents(each.path, inside, depth - 1)


def _digest_of(path: str) -> str:
    """What stands for the content of a file now."""
    try:
        file = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)  # or a pipe would wait for its writer
    except (OSError, ValueError):
        return _ABSENT
    try:
        info = os.fstat(file)
        if not stat.S_ISREG(info.st_mode):
            return _ABSENT if stat.S_ISDIR(info.st_mode) else _SPECIAL
        parts = [os.read(file, info.st_size + 1)]
        while parts[-1]:
            parts.append(os.read(file, 1 << 20))
        return digest(b"".join(parts))
    except OSError:
        return _ABSENT
    finally:
        os.close(file)


def _models_in(folder: str) -> list[str]:
    return sorted(name for name in os.listdir(folder) if name.endswith(".cdsl"))


class _Real:
    """`os.path.realpath`, of many files in a few folders."""

    def __init__(self) -> None:
        self._folders: dict[str, str] = {}

    def __call__(self, path: str) -> str:
        folder, name = os.path.split(path)
        if folder not in self._folders:
            self._folders[folder] = os.path.realpath(folder)
        found = os.path.join(self._folders[folder], name)
        return os.path.realpath(found) if os.path.islink(found) or name in ("", ".", "..") else found


# The generator.


def generator(own: Path = Path(__file__).parent.parent) -> str:
    """What stands for everything that decides what is made of the models; `own` is the folder of this package."""
    plugins = sorted((each.group, each.name, each.value) for each in installed.extensions())
    others = sorted({value.partition(":")[0].partition(".")[0] for _, _, value in plugins} - {own.name})
    told = [
        __version__,
        sys.version,
        sys.path,
        [_packages(each) for each in sys.path],
        plugins,
        _tree(str(own)),
        [_module(each) for each in others],
    ]
    return digest(json.dumps(told).encode())


def _packages(entry: str) -> list[str]:
    """The names and versions of what is installed in a folder of `sys.path`."""
    try:
        names = os.listdir(entry or ".")
    except OSError:
        return [_digest_of(entry)]
    return sorted(name for name in names if name.endswith((".dist-info", ".egg-info", ".egg-link", ".pth")))


def _module(name: str) -> list[str]:
    """What stands for the code of a top-level module."""
    try:
        spec = importlib.util.find_spec(name)
    except (ImportError, ValueError):
        spec = None
    if spec is None:
        return []
    folders = [_tree(each) for each in spec.submodule_search_locations or ()]
    return folders or [_digest_of(spec.origin or "")]


def _tree(folder: str) -> str:
    """What stands for all files below a folder, except for compiled ones."""
    found = {}
    for here, folders, names in os.walk(folder):
        folders[:] = [each for each in folders if each != "__pycache__"]
        for path in (os.path.join(here, name) for name in names):
            found[os.path.relpath(path, folder)] = _digest_of(path)
    return together(found)
