"""`rc rename`: rename a definition in all models and in the Python code that uses it."""

from __future__ import annotations

import argparse
import difflib
import re
import shlex
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from .common import FINE, WRONG, add_include, complain
from .completing import completed
from .replacing import replace_file

if TYPE_CHECKING:
    from ..dsl.source import Span
    from ..lsp.index import Index
    from ..lsp.outline import Symbol
    from ..lsp.project import Project
    from ..usercode.renaming import Names

NAME = "rename"

_ABOUT = """\
Change a name wherever the models in a folder have it, and in the Python code of the components that use it. The changes
are shown as a diff, and made if you agree.
"""
_EXAMPLES = """\
examples:
  rc rename Vault.idsl Vault.size count       an operation: in models, in handlers Vault_size, in calls of proxies
  rc rename patrol.smdsl resting waiting      a state: methods sm_resting, transitions t_resting_to_…
  rc rename patrol.pdsl max_speed top_speed   a parameter: self.params.max_speed
  rc rename patrol.cdsl poll look             a timer: method timer_poll, self.timers.poll
  rc rename house.ddsl front nose             a named instance: self.laser.add("front", ...), requires Laser from front
  rc rename --yes Vault.idsl Vault.size count
  rc rename --in robot Vault.idsl Vault Safe  an interface; in the models and components in robot/ and below

What may mean the old name, but is not certain to, is listed, and left alone: texts, comments, configurations.
Afterwards `rcgen` has to be run.

exit status: 0 renamed, 1 nothing was changed, 2 usage
"""


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description, to.epilog = _ABOUT, _EXAMPLES
    model = to.add_argument("file", type=Path, metavar="FILE", help="the model that defines it")
    completed(model, ".idsl", ".cdsl", ".ddsl", ".pdsl", ".smdsl")
    to.add_argument("old", metavar="NAME", help="its present name, such as `size`, or `Vault.size` if several have it")
    to.add_argument("new", metavar="NEW", help="its new name")
    to.add_argument("--yes", action="store_true", help="do not ask")
    to.add_argument(
        "--in", dest="folder", type=Path, metavar="DIR", help="where models and code are (default: this folder)"
    )
    add_include(to)


@dataclass
class _Changes:
    """Files before and after the renaming, and what the user has to check."""

    before: dict[Path, bytes] = field(default_factory=dict)
    after: dict[Path, bytes] = field(default_factory=dict)
    left: list[str] = field(default_factory=list)
    """Lines about what is left to the user: `PATH:LINE: TEXT`."""
    outdated: list[Path] = field(default_factory=list)
    """Models of components that have to be generated again."""

    def add(self, path: Path, before: bytes, after: bytes) -> None:
        if before != after:
            self.before[path], self.after[path] = before, after


def run(options: argparse.Namespace) -> int:
    from ..lsp.rename import CannotRename
    from ..spelling import and_then

    try:
        folder = options.folder or _around(options.file)
        changes = _collected(options.file, options.old, options.new, folder, options.include)
    except CannotRename as exc:
        return complain(f"rc rename: {and_then(str(exc), 'nothing was changed')}")
    except ModuleNotFoundError as exc:
        if exc.name != "libcst":
            raise
        return complain("rc rename: it needs libcst; run: pip install 'robocomp-py[rename]'")
    for path, after in changes.after.items():
        sys.stdout.writelines(_difference(path, changes.before[path], after))
    for line in changes.left:
        print(f"not changed: {line}")
    if not changes.after:
        return complain("rc rename: there is nothing to change")
    if not (options.yes or _agreed(len(changes.after))):
        return WRONG
    if code := _write(changes):
        return code
    print(f"{len(changes.after)} file{'' if len(changes.after) == 1 else 's'} changed")
    if changes.outdated:
        print(f"run: rcgen {shlex.join(map(str, changes.outdated))}")
    return FINE


def _around(file: Path) -> Path:
    """The working directory, or the folder of a file that is not in it or below."""
    return Path(".") if Path.cwd() in file.resolve().parents else file.parent


def _agreed(files: int) -> bool:
    """Ask whether to change this number of files."""
    if not sys.stdin.isatty():
        complain("rc rename: nothing was changed: cannot ask, since stdin is not a terminal; use --yes")
        return False
    try:
        answer = input(f"Change {files} file{'' if files == 1 else 's'}? [y/N] ")
    except EOFError:
        answer = ""
    if answer.strip().lower() in ("y", "yes"):
        return True
    complain("rc rename: nothing was changed")
    return False


def _collected(file: Path, old: str, new: str, folder: Path, include: Iterable[Path]) -> _Changes:
    from ..lsp.edits import apply
    from ..lsp.index import Index
    from ..lsp.outline import Kind
    from ..lsp.project import Project, without_mark
    from ..lsp.rename import by_file, namesakes, rename, users_of

    project = Project([folder], list(include))
    project.forget_disk()  # the cached relative paths may belong to another working directory
    index = Index(project)
    symbol = _symbol(index, file, old)
    home = symbol.name.span.source.path
    edits = rename(index, home, symbol.name.span.start, new).edits
    changes, texts = _Changes(), dict[Path, str]()
    for path, some in by_file(edits).items():
        texts[path] = apply(without_mark(project.text(path)), some)
        before = project.read(path)
        changes.add(path, before, _encoded(texts[path], before))
    after = project.with_texts(texts.items())
    if symbol.kind is Kind.NAMED:
        _change_named(changes, project, symbol.name.text, new, users_of(index, symbol))
        changes.left += [f"{_where(each.name.span)}: {each.span.text}" for each in namesakes(index, symbol)]
        changes.left += _all_wrong_now(project, after)
    else:
        _change_code(changes, project, after, users_of(index, symbol))
    return changes


def _change_named(changes: _Changes, project: Project, old: str, new: str, models: Iterable[Path]) -> None:
    """Add the changes of the code of the component that offers a named instance."""
    from ..usercode.renaming import Names

    for cdsl in models:
        linked = project.workspace().component(cdsl)
        ports = linked.component.named if linked else ()
        _rewrite_code(changes, project, cdsl, Names(instances={port.attribute: {old: new} for port in ports}))
        config = cdsl.parent / "etc" / "config.toml"
        lines = project.text(config).splitlines() if config.is_file() else []
        tables = re.compile(rf"\s*\[+offers\.{re.escape(old)}\b")
        changes.left += [f"{config}:{number}: {line}" for number, line in enumerate(lines, 1) if tables.match(line)]


def _symbol(index: Index, file: Path, old: str) -> Symbol:
    """The definition with a name in a model."""
    from ..lsp.rename import CannotRename, can_be_renamed
    from ..spelling import unknown

    made = index.outline(file)
    if made is None:
        raise CannotRename(f"{file} cannot be read as a model")
    parts = [part for part in old.replace("::", ".").split(".") if part]
    known = [each for each in made.walk() if can_be_renamed(each)]
    found = [each for each in known if parts and each.qualified.split("::")[-len(parts) :] == parts]
    match found:
        case [symbol]:
            return symbol
        case []:
            names = dict.fromkeys(".".join(each.qualified.split("::")[-max(1, len(parts)) :]) for each in known)
            raise CannotRename(f"{file}: {unknown('name', old, names)}")
        case _:
            names = dict.fromkeys(f"`{each.qualified.replace('::', '.')}`" for each in found)
            raise CannotRename(f"{file}: {old} may be {' or '.join(names)}; say which")


def _change_code(changes: _Changes, before: Project, after: Project, models: Iterable[Path]) -> None:
    """Add the changes of the code of these components."""
    from ..lsp.rename import CannotRename
    from ..usercode.renaming import differences

    for cdsl in models:
        old, new = before.workspace().component(cdsl), after.workspace().component(cdsl)
        if old is None or new is None:
            raise CannotRename(f"{cdsl} has mistakes; rc lint {cdsl} tells them")
        changes.outdated.append(cdsl)
        _rewrite_code(changes, before, cdsl, differences(old.component, new.component))
        changes.left += _wrong_now(cdsl.parent / "etc" / "config.toml", before, after)
    changes.left += _all_wrong_now(before, after)


def _rewrite_code(changes: _Changes, project: Project, cdsl: Path, names: Names) -> None:
    """Add the changes of the Python files of a component."""
    from ..lsp.rename import CannotRename
    from ..usercode.reading import python_files
    from ..usercode.renaming import NotParsed, rewrite, words_in

    for path in python_files(cdsl.parent) if names else ():
        data = project.read(path)
        if taken := words_in(data, list(names.words.values())):
            raise CannotRename(f"{path} has the name `{taken[0]}` already")
        try:
            rewritten = rewrite(data, names)
        except NotParsed as exc:
            changes.left.append(f"{path} is not valid Python: {exc}")
            continue
        changes.add(path, data, rewritten.data)
        changes.left += [f"{path}:{number}: {line}" for number, line in rewritten.left]


def _all_wrong_now(before: Project, after: Project) -> Iterator[str]:
    """The errors of all networks that they did not have before."""
    for path in before.files():
        if path.suffix.lower() == ".ddsl":
            yield from _wrong_now(path, before, after)


def _wrong_now(path: Path, before: Project, after: Project) -> Iterator[str]:
    """The errors of a file that it did not have before."""
    if not path.is_file():
        return
    known = {(each.code, each.message) for each in before.check(path)}
    for each in after.check(path):
        if (each.code, each.message) not in known and each.span.source.path == path:
            yield f"{_where(each.span)}: {each.message}"


def _where(span: Span) -> str:
    return f"{span.source.path}:{span.source.position(span.start)[0]}"


def _encoded(text: str, before: bytes) -> bytes:
    """A model's text in the encoding of its file."""
    for encoding in ("utf-8-sig" if before.startswith(b"\xef\xbb\xbf") else "utf-8", "latin-1"):
        try:
            before.decode(encoding)
        except UnicodeDecodeError:
            continue
        return text.encode(encoding)
    raise AssertionError("every byte is a character of Latin-1")


def _difference(path: Path, before: bytes, after: bytes) -> Iterator[str]:
    old, new = (data.decode("utf-8", "replace").splitlines(keepends=True) for data in (before, after))
    for line in difflib.unified_diff(old, new, str(path), str(path)):
        yield line if line.endswith("\n") else f"{line}\n\\ No newline at end of file\n"


def _write(changes: _Changes) -> int:
    """Write all files, or none."""
    done: list[Path] = []
    try:
        for path, data in changes.after.items():
            replace_file(path, data)
            done.append(path)
    except OSError as exc:
        left = _restore(done, changes.before)
        state = f"{', '.join(map(str, left))} cannot be restored" if left else "nothing was changed"
        return complain(f"rc rename: {path}: {exc.strerror}; {state}")
    return FINE


def _restore(done: Iterable[Path], before: Mapping[Path, bytes]) -> list[Path]:
    """Restore the content of files; returns those for which this failed."""
    failed = []
    for path in done:
        try:
            replace_file(path, before[path])
        except OSError:
            failed.append(path)
    return failed
