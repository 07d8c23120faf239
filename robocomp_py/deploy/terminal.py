"""A network on a terminal, or in a file: lines with the names of those who wrote them."""

from __future__ import annotations

import contextlib
import os
import sys
from typing import IO, Any, TextIO, cast

from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from .plan import Member, Plan, Process
from .policy import State
from .run import Display, Options, run

_COLOURS = ("cyan", "green", "yellow", "magenta", "blue", "bright_red", "bright_cyan", "bright_green")
_STYLES = {
    State.WAITING: "dim",
    State.STARTING: "yellow",
    State.READY: "green",
    State.STOPPING: "yellow",
    State.ENDED: "dim",
    State.FAILED: "bold red",
}


def run_on_terminal(plan: Plan, options: Options) -> int:
    """Run a network, showing it on standard output for as long as that can be written. Returns the exit code."""
    console = Console(file=cast(IO[str], Output(sys.stdout, sys.stderr)), highlight=False, soft_wrap=True)
    display = Terminal(plan, console)
    if not console.is_terminal:
        return run(plan, options, display)
    with Live(display.table({}), console=console, auto_refresh=False, transient=True) as live:
        display.live = live
        return run(plan, options, display)


def table_of(plan: Plan) -> Table:
    """What would run."""
    table = Table(title=f"{plan.name} over {', '.join(plan.carriers)}")
    is_shared = any(process.members for process in plan.processes)
    for column in ("instance", "component", *(("process",) if is_shared else ()), "starts after", "uses"):
        table.add_column(column)
    for process in plan.processes:
        for each in process.members or (Member(process.name, process.component),):
            uses = ", ".join(f"{link.interface} of {link.provider}" for link in plan.links if link.client == each.name)
            shared = (process.name if process.members else "",) if is_shared else ()
            table.add_row(each.name, each.component, *shared, ", ".join(process.after), uses)
    return table


class Output:
    """A stream that may stop to take what is written, as a full disk or a closed pipe does.

    A network must not stop because nobody can see it: the rest is dropped then, and that is said once.
    """

    def __init__(self, stream: TextIO, complaints: TextIO) -> None:
        self._stream, self._complaints = stream, complaints
        self._works = True

    def write(self, text: str) -> int:
        if self._works:
            try:
                self._stream.write(text)
            except OSError as exc:
                self._give_up(exc)
        return len(text)

    def flush(self) -> None:
        if self._works:
            try:
                self._stream.flush()
            except OSError as exc:
                self._give_up(exc)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def _give_up(self, exc: OSError) -> None:
        self._works = False
        discard(self._stream)
        with contextlib.suppress(OSError):
            print(f"rcdeploy: output is lost from here on, the network goes on: {exc.strerror}", file=self._complaints)


def discard(stream: TextIO) -> None:
    """Have a stream that cannot be written lead nowhere, or what it still holds fails again when Python ends."""
    with contextlib.suppress(OSError), open(os.devnull, "wb") as nowhere:
        os.dup2(nowhere.fileno(), stream.fileno())


class Terminal(Display):
    """Lines with coloured names; on a terminal, a table of all states below them."""

    def __init__(self, plan: Plan, console: Console) -> None:
        self._plan, self._console = plan, console
        names = [process.name for process in plan.processes]
        self._width = max(map(len, names))
        self._called = {each.name: _called(each) for each in plan.processes}
        self._colours = {name: _COLOURS[n % len(_COLOURS)] for n, name in enumerate(names)}
        self._states: dict[str, State] = {}
        self._bar, self._rule = ("│", "─") if _can_show("│─", console.encoding) else ("|", "-")
        self.live: Live | None = None

    def line(self, name: str, text: str) -> None:
        style = "red" if text.startswith(("ERROR", "CRITICAL")) else "yellow" if text.startswith("WARNING") else ""
        begin = f"{name:>{self._width}} {self._bar} "
        self._console.print(Text.assemble((begin, self._colours[name]), (text.removeprefix("INFO: "), style)))

    def states(self, states: dict[str, State]) -> None:
        self._states = states
        if self.live:
            self.live.update(self.table(states), refresh=True)

    def up(self) -> None:
        number = sum(len(each.instances) for each in self._plan.processes)
        ready = sum(len(each.instances) for each in self._plan.processes if self._states[each.name] is State.READY)
        if ready == number:
            whole = "the component" if number == 1 else f"all {number} components"
            self._say(f"{whole} of {self._plan.name} {'is' if number == 1 else 'are'} ready", "bold green")
        else:
            self._say(f"{ready} of {number} components of {self._plan.name} are ready, the others done", "bold green")

    def waiting(self, whom: list[str]) -> None:
        self._say(f"not ready yet: {', '.join(whom)}", "yellow")

    def ended(self, name: str, how: str) -> None:
        self._say(f"{self._called.get(name, name)} {how}", "yellow")

    def failed(self, name: str, how: str, last: list[str]) -> None:
        self._say(f"{self._called[name]} {how}", "bold red")
        if last:
            self._say(f"the last lines of {name}:", "red")
        for text in last:
            self._console.print(Text(f"    {text}", style="red"))

    def stopping(self, why: str) -> None:
        self._say(f"stopping: {why}", "bold")

    def table(self, states: dict[str, State]) -> Group:
        cells = []
        for process in self._plan.processes:
            state = states.get(process.name, State.WAITING)
            name = (self._called[process.name], self._colours[process.name])
            cells.append(Text.assemble(name, " ", (str(state), _STYLES[state])))
        return Group(Text(self._rule * 40, style="dim"), Text("  ").join(cells))

    def _say(self, text: str, style: str) -> None:
        self._console.print(Text(f"{'rcdeploy':>{self._width}} {self._bar} {text}", style=style))


def _called(process: Process) -> str:
    """A process, with those that share it."""
    return f"{process.name} ({', '.join(process.instances)})" if process.members else process.name


def _can_show(text: str, encoding: str) -> bool:
    try:
        text.encode(encoding)
    except (UnicodeEncodeError, LookupError):
        return False
    return True
