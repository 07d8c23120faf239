"""Measures reading and checking files of the languages, and generating a component.

Within this process, as in an editor: grammars are loaded, and one file has changed. As processes, as on a
command line: with the interpreter, imports and grammars. The least of several rounds counts. The files are
generated here, and similar to those of users.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from robocomp_py.dsl.workspace import SHIPPED, Workspace, read_file

from .query import Tell
from .rounds import Effort
from .tables import Table

IDSLS, CDSLS = 150, 80
"""Files of the tree."""

LINES = (500, 5_000, 50_000)
COMPONENT = """\
import "Laser.idsl";
import "Speech.idsl";
import "LaserPub.idsl";

Component explorer
{
    Communications
    {
        requires Laser;
        implements Speech;
        subscribesTo LaserPub;
    };
    language python;
};
"""


@dataclass(frozen=True)
class Row:
    what: str
    lines: int
    seconds: float
    goal: float | None = None


def run(effort: Effort, tell: Tell) -> list[Row]:
    rows = []
    typical = (SHIPPED / "Laser.idsl").read_text(encoding="utf-8")
    tell("languages · in one process")
    rows.append(_row("a typical IDSL", typical, effort, 0.005))
    for lines in LINES:
        rows.append(_row(f"an IDSL of {lines} lines", interfaces("Big", lines), effort, 0.03 if lines == 500 else None))
    with tempfile.TemporaryDirectory(prefix="rc-") as folder:
        files = [*tree(Path(folder))]
        tell("languages · whole processes")
        lint = [sys.executable, "-m", "robocomp_py.cli.rc", "lint", *map(str, files)]
        lines = sum(len(each.read_text(encoding="utf-8").splitlines()) for each in files)
        rows.append(Row(f"`rc lint`, {IDSLS} IDSLs and {CDSLS} CDSLs", lines, _process(lint, effort), 3.0))
        component = Path(folder, "explorer.cdsl")
        component.write_text(COMPONENT, encoding="utf-8")
        rcgen = [sys.executable, "-m", "robocomp_py.cli.rcgen", str(component), "-o", str(Path(folder, "explorer"))]
        rows.append(Row("`rcgen` of one component", len(COMPONENT.splitlines()), _process(rcgen, effort), 0.5))
    return rows


def _row(what: str, text: str, effort: Effort, goal: float | None) -> Row:
    return Row(what, len(text.splitlines()), _least(lambda: _check(text), effort.rounds), goal)


def _check(text: str) -> None:
    """Parse and check a text that was never read before."""
    path, data = Path("/nowhere/Big.idsl"), text.encode()
    workspace = Workspace(read=lambda wanted: data if wanted == path else read_file(wanted), middlewares=())
    workspace.check(path)
    if workspace.report.diagnostics:
        raise RuntimeError(workspace.report.diagnostics[0].render())


def _process(command: list[str], effort: Effort) -> float:
    def once() -> None:
        subprocess.run(command, check=True, capture_output=True)

    once()  # bytecode is compiled, and files are in the disk cache, as from the second time on
    return _least(once, effort.rounds)


def _least(call: Callable[[], None], rounds: int) -> float:
    """The least seconds that a call takes, because other work of the machine can only add to it."""
    taken = []
    for _ in range(rounds + 1):
        begun = time.perf_counter()
        call()
        taken.append(time.perf_counter() - begun)
    return min(taken[1:])


# Files.


def interfaces(name: str, lines: int, imports: str = "") -> str:
    """An IDSL file of about this number of lines."""
    written = [*imports.splitlines(), f"module RoboComp{name}", "{"]
    for number in range(max(1, lines // len(_definitions("")))):
        written += _definitions(f"{name}{number}")
    return "\n".join([*written, "};", ""])


def tree(folder: Path) -> Iterator[Path]:
    """Interfaces that import one another by tens, and components that use them."""
    for number in range(IDSLS):
        imports = f'import "I{number - 1}.idsl";' if number % 10 else ""
        path = folder / f"I{number}.idsl"
        path.write_text(interfaces(f"I{number}", 60, imports), encoding="utf-8")
        yield path
    for number in range(CDSLS):
        used = [(number + step) % IDSLS for step in (0, 20, 40, 60)]
        names = [f"I{each}0Device" for each in used]
        imports = "".join(f'import "I{each}.idsl";\n' for each in used)
        path = folder / f"c{number}.cdsl"
        path.write_text(
            f"{imports}\nComponent c{number}\n{{\n    Communications\n    {{\n"
            f"        requires {names[0]}, {names[1]};\n        implements {names[2]}, {names[3]};\n"
            "    };\n    language python;\n    period 50 ms;\n};\n",
            encoding="utf-8",
        )
        yield path


def _definitions(name: str) -> list[str]:
    return [
        f"    // What {name} says",
        f"    struct {name}Thing",
        "    {",
        "        float x; // m",
        "        int id = 3;",
        "        string text;",
        "    };",
        f"    sequence<{name}Thing> {name}Things;",
        f"    enum {name}Mode {{ {name}Off, {name}On }};",
        f"    exception {name}Failed {{ string what; }};",
        f"    interface {name}Device",
        "    {",
        f"        {name}Things get(int first, out {name}Thing last, {name}Mode mode) throws {name}Failed;",
        f"        void set({name}Thing to);",
        "    };",
    ]


def table(rows: list[Row]) -> Table:
    head = ("", "lines", "time", "µs per line", "goal")
    cells = [
        (
            row.what,
            f"{row.lines}",
            _time(row.seconds),
            f"{row.seconds / row.lines * 1e6:.0f}" if row.lines > 300 else "",
            f"≤ {_time(row.goal)}: {'met' if row.seconds <= row.goal else 'missed'}" if row.goal else "",
        )
        for row in rows
    ]
    return Table("languages", "files of the languages", head, cells, labels=1)


def _time(seconds: float) -> str:
    return f"{seconds:.2f} s" if seconds >= 0.2 else f"{seconds * 1000:.3g} ms"
