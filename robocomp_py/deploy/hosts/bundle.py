"""The archive for a host: the needed part of this package, the files that processes name, and keys.

    robocomp_py/…                    without what reads models and generates code
    robocomp_py-VERSION.dist-info/   so that its transports are found
    files/NAME/…                     folders of components, configurations, programs: see `relocation`
    keys/…                           of that host alone, for its user's eyes only

The name of the archive is the SHA-256 of its content, which depends on the files alone: a host that has it does not
get it again.
"""

from __future__ import annotations

import hashlib
import io
import os
import tarfile
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath

from ... import installed
from ...errors import DeploymentError
from ...version import __version__

FILES, KEYS = "files", "keys"

LARGEST = 256 * 1024 * 1024
"""Octets of a bundle. Copy larger files (models, maps) there once yourself."""

_PACKAGE = Path(__file__).resolve().parents[2]

_NOT_THERE = (
    "lsp",
    "codegen",
    "testing",
    "deploy/exporters",
    "interfaces",
    "graph",
    "dsl/idsl",
    "dsl/cdsl",
    "dsl/pdsl",
    "dsl/ddsl",
    "dsl/smdsl",
)
"""Folders of this package that only workstations need."""

_NOT_SENT = ("__pycache__", ".git", ".venv", ".mypy_cache", ".ruff_cache", ".pytest_cache")


@dataclass(frozen=True)
class Content:
    """A file of a bundle."""

    data: bytes = field(repr=False)
    executable: bool = False


@dataclass(frozen=True)
class Bundle:
    name: str
    """SHA-256 of the archive."""
    packed: bytes = field(repr=False)
    """The archive, as it is sent."""
    size: int = 0
    """Octets of its content."""


def pack(contents: Mapping[str, Content]) -> Bundle:
    """An archive of these files, by their paths in it."""
    archive = io.BytesIO()
    with tarfile.open(fileobj=archive, mode="w", format=tarfile.PAX_FORMAT) as members:
        for path in sorted(contents):
            content = contents[path]
            member = tarfile.TarInfo(path)
            member.size, member.mode = len(content.data), 0o700 if content.executable else 0o600
            members.addfile(member, io.BytesIO(content.data))
    plain = archive.getvalue()
    deflate = zlib.compressobj(6, wbits=31)
    packed = deflate.compress(plain) + deflate.flush()
    return Bundle(hashlib.sha256(plain).hexdigest(), packed, sum(len(each.data) for each in contents.values()))


def collect(files: Mapping[Path, str], keys: Mapping[Path, str] | None = None) -> dict[str, Content]:
    """What a host needs: our package, these files and folders at their places below `files`, and these keys below
    `keys`. Raises DeploymentError if something cannot be read, or is too large."""
    found = dict(_package())
    wanted = [(PurePosixPath(place, inside), file) for path, place in files.items() for inside, file in _walk(path)]
    wanted += [(PurePosixPath(KEYS, place), path) for path, place in (keys or {}).items()]
    left = LARGEST
    for at, file in wanted:
        found[str(at)] = content = _read(file)
        left -= len(content.data)
        if left < 0:
            raise DeploymentError(
                f"{file}: with this file, the files of the components exceed {LARGEST // 1_000_000} MB, the most that "
                "is sent to a host; copy large files there yourself, and tell the component where they are"
            )
    return found


def _package() -> Iterator[tuple[str, Content]]:
    left_out = tuple(f"{each}/" for each in _NOT_THERE)
    for inside, path in _walk(_PACKAGE):
        if path.suffix in (".py", ".typed") and not inside.startswith(left_out):
            yield f"robocomp_py/{inside}", _read(path)
    folder = f"robocomp_py-{__version__}.dist-info"
    yield f"{folder}/METADATA", Content(f"Metadata-Version: 2.1\nName: robocomp-py\nVersion: {__version__}\n".encode())
    lines = []
    for group in (installed.TRANSPORTS, installed.DEPLOYMENTS):
        found = installed.entries(group).items()
        ours = [f"{name} = {entry.value}" for name, entry in found if entry.value.startswith("robocomp_py.")]
        lines += [f"[{group}]", *ours, ""]
    yield f"{folder}/entry_points.txt", Content("\n".join(lines).encode())


def _walk(root: Path) -> Iterator[tuple[str, Path]]:
    """The files of a folder, with their paths in it; of a file, itself alone. Links are followed, not in circles."""
    if not root.is_dir():
        yield "", root
        return
    yield from _inside(root, PurePosixPath(), {root.resolve()})


def _inside(folder: Path, at: PurePosixPath, around: set[Path]) -> Iterator[tuple[str, Path]]:
    try:
        there = sorted(os.scandir(folder), key=lambda entry: entry.name)
    except OSError as exc:
        raise DeploymentError(f"{folder} cannot be read: {exc.strerror}") from exc
    for entry in there:
        path = Path(entry.path)
        if entry.name in _NOT_SENT:
            continue
        if entry.is_dir():
            whole = path.resolve()
            if whole not in around:
                yield from _inside(path, at / entry.name, around | {whole})
        elif entry.is_file():  # no sockets, no pipes
            yield str(at / entry.name), path


def _read(path: Path) -> Content:
    try:
        if path.stat().st_size > LARGEST:
            raise DeploymentError(f"{path} is too large to be sent to a host; copy it there yourself")
        return Content(path.read_bytes(), os.access(path, os.X_OK))
    except OSError as exc:
        raise DeploymentError(f"{path} cannot be read: {exc.strerror}") from exc
