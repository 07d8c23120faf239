"""The pages of docs/diagnostics, one for each code. `python -m tests.docs.diagnostics` fills in the messages.

A page is made of a title (the code), a line `error · IDSL, CDSL`, what it means, and two sections, `## Wrong` and
`## Right`. In a section stand files: fenced, each below a line with its name in bold (`example` and the ending of its
language, if it has none). Behind the name may stand how it is saved: `, executable`, or `, saved as Latin-1`.
`## Right` leaves out files that stay as they are, unless it begins with "These files alone:". A `console` block shows
the commands that check the files. Without one, `rc lint` checks all files. The `text` block is what the commands print,
to the letter, where `...` stands for anything.
"""

from __future__ import annotations

import os
import re
import shlex
import stat
import subprocess
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import chdir, contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from io import StringIO
from pathlib import Path

from robocomp_py.cli import lint, rc, rcdeploy, rcgen
from robocomp_py.dsl.diagnostics import ordered
from robocomp_py.dsl.explanations import summary
from robocomp_py.dsl.workspace import ENDINGS

from .pages import ROOT

PAGES = ROOT / "docs" / "diagnostics"
INDEX = PAGES / "README.md"

LANGUAGES = ("IDSL", "CDSL", "PDSL", "DDSL", "SMDSL", "InnerModel", "configuration", "Python")
SEVERAL = "Several languages"

_PROGRAMS = {"rc": rc.main, "rcgen": rcgen.main, "rcdeploy": rcdeploy.main}

_BLOCK = re.compile(
    r"(?:^\*\*(?P<name>[^*\n]+)\*\*(?:, (?P<saved>[^\n]+))?\n\n)?^```(?P<kind>\w+)\n(?P<text>.*?)^```$",
    re.DOTALL | re.MULTILINE,
)
_HEAD = re.compile(
    r"\A# (?P<code>[a-z0-9-]+)\n\n(?P<severity>error|warning) · (?P<languages>[^\n]+)\n\n(?P<meaning>.+)", re.DOTALL
)


@dataclass(frozen=True)
class File:
    name: str
    text: str
    saved: str = ""

    def write(self, folder: Path) -> None:
        path = folder / self.name
        path.parent.mkdir(parents=True, exist_ok=True)
        match self.saved:
            case "saved as Latin-1":
                path.write_bytes(self.text.encode("latin-1"))
            case "executable":
                path.write_text(self.text)
                path.chmod(path.stat().st_mode | stat.S_IXUSR)
            case "":
                path.write_text(self.text, encoding="utf-8")
            case other:
                raise ValueError(f"{self.name}: nobody knows how to write it {other}")


@dataclass
class Example:
    """A section: files, the commands that check them, and what these say."""

    files: list[File] = field(default_factory=list)
    commands: list[str] = field(default_factory=list)
    said: str = ""

    def run(self, folder: Path) -> str:
        """What is said of the files; of several commands, what the last one says."""
        for each in self.files:
            each.write(folder)
        named = [Path(each.name) for each in self.files if Path(each.name).suffix in ENDINGS]
        said = "" if self.commands else _checked(named, folder)
        for command in self.commands:
            said = _run(command, folder)
        return said


@dataclass(frozen=True)
class Page:
    path: Path
    code: str
    severity: str
    languages: tuple[str, ...]
    meaning: str
    wrong: Example
    right: Example

    @property
    def summary(self) -> str:
        """Its first sentence."""
        return summary(self.path.read_text(encoding="utf-8"))


def _checked(files: list[Path], folder: Path) -> str:
    """What is wrong with files of a folder."""
    with chdir(folder), _environment(folder):
        return "".join(f"{each.render()}\n" for each in ordered(lint.check(files)))


def _run(command: str, folder: Path) -> str:
    """What a command prints in a folder."""
    program, *arguments = shlex.split(command)
    if program not in _PROGRAMS:
        done = subprocess.run(["bash", "-c", command], cwd=folder, text=True, capture_output=True, check=True)
        return done.stdout + done.stderr
    with chdir(folder), _environment(folder), StringIO() as output:
        with redirect_stdout(output), redirect_stderr(output):
            _PROGRAMS[program](arguments)
        return output.getvalue()


@contextmanager
def _environment(folder: Path) -> Iterator[None]:
    """That of a reader who has nothing else of RoboComp."""
    before = dict(os.environ)
    for name in ("ROBOCOMP", "ROBOCOMP_INTERFACES"):
        os.environ.pop(name, None)
    os.environ["HOME"] = str(folder)
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)


def matches(said: str, output: str) -> bool:
    """Whether an output is what a page says, where `...` stands for anything."""
    return bool(re.fullmatch(".*?".join(map(re.escape, said.split("..."))), output, re.DOTALL))


def read_page(path: Path) -> Page:
    text = path.read_text(encoding="utf-8")
    head, wrong, right = re.split(r"^## (?:Wrong|Right)$", text, flags=re.MULTILINE)
    found = _HEAD.match(head)
    if found is None:
        raise ValueError(f"{path.name} does not begin as a page does")
    languages = tuple(found["languages"].split(", "))
    before, after = _example(wrong), _example(right)
    if "These files alone:" not in right:
        changed = {each.name for each in after.files}
        after.files += [each for each in before.files if each.name not in changed]
    return Page(path, found["code"], found["severity"], languages, found["meaning"].strip(), before, after)


def read_pages() -> list[Page]:
    return [read_page(path) for path in sorted(PAGES.glob("*.md")) if path != INDEX]


def _example(section: str) -> Example:
    example = Example()
    for block in _BLOCK.finditer(section):
        match block["kind"]:
            case "text":
                example.said = block["text"]
            case "console":
                example.commands += [line.removeprefix("$ ") for line in block["text"].splitlines()]
            case kind:
                name = block["name"] or f"example.{kind}"
                example.files.append(File(name, block["text"], block["saved"] or ""))
    return example


def index(pages: Iterable[Page]) -> str:
    """The page that lists them all."""
    lists: dict[str, list[Page]] = {name: [] for name in (SEVERAL, *LANGUAGES)}
    for page in pages:
        lists[page.languages[0] if len(page.languages) == 1 else SEVERAL].append(page)
    parts = [_INTRODUCTION]
    for name, listed in lists.items():
        if listed:
            rows = "".join(f"| [{each.code}]({each.code}.md) | {each.severity} | {each.summary} |\n" for each in listed)
            parts.append(f"## {name}\n\n| code | severity | what is wrong |\n|---|---|---|\n{rows}")
    return "\n".join(parts)


def filled(page: Page) -> str:
    """A page's text, with what is said today."""
    with tempfile.TemporaryDirectory() as folder:
        output = page.wrong.run(Path(folder))
    text = page.path.read_text(encoding="utf-8")
    if matches(page.wrong.said, output):
        return text
    return text.replace(f"```text\n{page.wrong.said}```", f"```text\n{output}```", 1)


_INTRODUCTION = """\
# Diagnostics

Every message of `rc lint`, `rcgen`, `rcdeploy` and the editors has a code in brackets, which stays the same in all
versions. Each code has a page here with a meaning, a wrong example and a right one, which leaves out files that stay
as they are. `rc lint --explain CODE` prints the page.

An error prevents generation and start; a warning does not. One run reports all independent mistakes, each once, and
suggests similar names.

| command | output |
|---|---|
| `rc lint FILE…` | for people, to stderr: place, line, advice, and the number of findings |
| `rc lint --json FILE…` | to stdout, one object a line, with the keys below |
| `rc lint --sarif FILE…` | to stdout, SARIF 2.1.0 for tools of code review |

The JSON keys are `file line column end_line end_column severity code message hint`. Lines and columns count from 1,
columns in characters. The end is the place behind the last character. The exit status is 1 if there is an error, else
0. For a folder, all files of the languages in it are checked, except hidden ones and linked folders; for a network
(`.ddsl`), everything that it deploys. File names are relative to the working directory.
"""


def main() -> None:
    for page in read_pages():
        text = filled(page)
        if text != page.path.read_text(encoding="utf-8"):
            page.path.write_text(text, encoding="utf-8")
            print(f"rewritten: {page.path.relative_to(ROOT)}")
    INDEX.write_text(index(read_pages()), encoding="utf-8")


if __name__ == "__main__":
    main()
