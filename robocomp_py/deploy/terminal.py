"""A network on a terminal, or in a file: lines with the names of the processes that printed them.

On a terminal, a table of all processes follows them. The lines are also kept for `rcdeploy logs`, at a
socket that is open as long as the network runs.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import os
import sys
import time
from collections.abc import AsyncIterator, Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import IO, cast

from rich.console import Console, Group
from rich.live import Live
from rich.text import Text

from .control import Control
from .harmless import harmless
from .logs import Logs
from .naming import DEPLOYER
from .place import Place, Run
from .plan import Plan, Process
from .policy import State
from .ring import Line, Ring, printed
from .run import Options, run
from .snapshot import Network
from .streams import Output
from .table import Span, clock_time, summary, table
from .telling import Display

_COLOURS = ("cyan", "green", "yellow", "magenta", "blue", "bright_red", "bright_cyan", "bright_green")

_STYLES = {"WARNING": "yellow", "ERROR": "red", "CRITICAL": "red"}
"""Of the levels of log records."""

_SOON_S = 0.05
"""Seconds after which new lines are shown on a terminal, all at once."""

_TICK_S = 1.0
"""Seconds between two measurements of the processes' usage."""

_MANY = 1000
"""Lines that are shown at once, whenever they come."""


def run_on_terminal(plan: Plan, options: Options, leave: Callable[[Path], object] | None, logs: Logs) -> int:
    """Run a network, showing it on standard output for as long as that can be written. Returns the exit code.

    `logs` keep what the components print. `leave` is called when everything is ready, if nothing is to be shown from
    then on; with a file for complaints.
    """
    size = os.get_terminal_size(sys.stdout.fileno()) if sys.stdout.isatty() else None
    console = Console(
        file=cast(IO[str], Output(sys.stdout, sys.stderr)),
        highlight=False,
        soft_wrap=True,
        width=size.columns if size and leave else None,  # when detaching, the size is fixed: the terminal will go
        height=size.lines if size and leave else None,
    )
    terminal = Terminal(plan, console, leave)
    terminal.keep(logs)
    with terminal.showing_warnings():
        return run(plan, options, terminal, [terminal.watching])


class Terminal(Display):
    """Lines with coloured names; on a terminal, a table of all processes below them."""

    def __init__(
        self,
        plan: Plan,
        console: Console,
        leave: Callable[[Path], object] | None = None,
        clock: Callable[[], float] = time.time,
    ) -> None:
        self._plan, self._console, self._leave, self._clock = plan, console, leave, clock
        names = [process.name for process in plan.processes]
        self._width = max(map(len, names))
        self._called = {each.name: _called(each) for each in plan.processes}
        self._colours = {name: _COLOURS[n % len(_COLOURS)] for n, name in enumerate(names)}
        self._states: dict[str, State] = {}
        self._bar, self._rule = ("│", "─") if _can_show("│─", console.encoding) else ("|", "-")
        self._ring = Ring()
        self._place = Place(plan.name)
        self._live: _Live | None = None
        self._shown = True
        self._logs: Logs | None = None

    @contextlib.asynccontextmanager
    async def watching(self, network: Network) -> AsyncIterator[None]:
        """While the network runs: the table, and the control socket."""
        control = Control(network, self._ring)
        try:
            self._place.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            await control.open(self._place.control)
            self._place.leave_plan(json.dumps(self._plan.to_json()))
            if self._logs:
                self._place.leave_run(Run(self._logs.folder, self._logs.began))
        except OSError as exc:
            self._say(
                f"rcdeploy status, logs and down cannot reach this network: {self._place.folder}: {exc.strerror}",
                "yellow",
            )
        if self._console.is_terminal:
            self._live = _Live(network, self._console, self._rule, self._colours)
            self._live.begin()
        try:
            yield
        finally:
            self._end_live()
            await control.close()

    def keep(self, logs: Logs) -> None:
        """Write further output to files, too."""
        self._logs = logs
        self._ring.follow(logs.write)

    @contextlib.contextmanager
    def showing_warnings(self) -> Iterator[None]:
        """While entered, log messages about launching are shown like other lines: without a terminal stderr is lost,
        and on a terminal they would tear the table. Such messages come from the event loop's thread only.
        """
        handler, log = _Saying(lambda text: self._say(text, "yellow")), logging.getLogger("robocomp.deploy")
        log.addHandler(handler)
        try:
            yield
        finally:
            log.removeHandler(handler)

    def line(self, name: str, text: str) -> None:
        line = printed(self._clock(), name, text)
        self._tell(line, line.text.removeprefix("INFO: "), self._colours[name], _STYLES.get(line.level, ""))

    def states(self, states: dict[str, State]) -> None:
        self._states = states
        if self._live:
            self._live.soon()

    def up(self) -> None:
        number = sum(len(each.instances) for each in self._plan.processes)
        ready = sum(len(each.instances) for each in self._plan.processes if self._states[each.name] is State.READY)
        if ready == number:
            whole = {1: "the component", 2: "both components"}.get(number, f"all {number} components")
            self._say(f"{whole} of {self._plan.name} {'is' if number == 1 else 'are'} ready", "bold green")
        else:
            self._say(
                f"{ready} of {number} components of {self._plan.name} are ready, the others have finished", "bold green"
            )
        if self._leave:
            self._end_live()
            self._shown = False
            self._leave(self._place.complaints)

    def waiting(self, names: list[str]) -> None:
        self._say(f"not ready yet: {', '.join(names)}", "yellow")

    def ended(self, name: str, how: str) -> None:
        self._say(f"{self._called.get(name, name)} {how}", "yellow")

    def failed(self, name: str, how: str) -> None:
        self._say(f"{self._called[name]} {how}", "bold red")

    def tell(self, text: str) -> None:
        self._say(text, "")

    def stopping(self, why: str) -> None:
        self._say(f"stopping: {why}", "bold")

    def _say(self, text: str, style: str) -> None:
        self._tell(Line(self._clock(), DEPLOYER, text), text, style, style)

    def _tell(self, line: Line, shown: str, colour: str, style: str) -> None:
        """Keep a line, and show it with its time."""
        self._ring.write(line)
        if self._shown:
            head = f"{line.name:>{self._width}} {self._bar} "
            for each in shown.split("\n"):
                self._show((f"{clock_time(line.at)} ", "dim"), (head, colour), (each, style))

    def _show(self, *spans: Span) -> None:
        spans = tuple((harmless(text), style) for text, style in spans)
        if self._live:
            self._live.show(spans)
        elif self._console.is_terminal:
            self._console.print(Text.assemble(*spans))
        else:  # directly: rich would take longer than all the rest
            self._console.file.write("".join(text for text, _ in spans) + "\n")
            self._console.file.flush()

    def _end_live(self) -> None:
        if self._live:
            self._live.end()
        self._live = None


class _Saying(logging.Handler):
    def __init__(self, say: Callable[[str], object]) -> None:
        super().__init__(logging.WARNING)
        self._say = say

    def emit(self, record: logging.LogRecord) -> None:
        self._say(record.getMessage())


class _Live:
    """Scrolling lines above a fixed table, drawn by an event loop at a limited rate."""

    def __init__(self, network: Network, console: Console, rule: str, colours: Mapping[str, str]) -> None:
        self._network, self._console, self._rule, self._colours = network, console, rule, colours
        self._live = Live(console=console, auto_refresh=False, transient=True)
        self._lines: list[Text] = []
        self._timer: asyncio.TimerHandle | None = None

    def begin(self) -> None:
        self._live.start()
        self._draw()

    def end(self) -> None:
        """Keep the lines, and remove the table."""
        if self._timer:
            self._timer.cancel()
        self._print()
        self._live.update("")
        self._live.stop()

    def show(self, spans: Sequence[Span]) -> None:
        self._lines.append(Text.assemble(*spans))
        if len(self._lines) >= _MANY:
            self._print()
        self.soon()

    def soon(self) -> None:
        loop = asyncio.get_running_loop()
        if self._timer and self._timer.when() - loop.time() <= _SOON_S:
            return
        self._draw_after(_SOON_S)

    def _draw_after(self, seconds: float) -> None:
        if self._timer:
            self._timer.cancel()
        self._timer = asyncio.get_running_loop().call_later(seconds, self._draw)

    def _draw(self) -> None:
        self._print()
        snapshot, width = self._network.snapshot(), self._console.width
        lines = table(snapshot, width=width, height=max(4, self._console.height // 2), colours=self._colours)
        drawn = [Text.assemble(*line, no_wrap=True, overflow="ellipsis") for line in (summary(snapshot), *lines)]
        self._live.update(Group(Text(self._rule * min(width, 40), style="dim"), *drawn), refresh=True)
        self._draw_after(_TICK_S)

    def _print(self) -> None:
        if self._lines:
            self._console.print(Text("\n").join(self._lines))
        self._lines = []


def _called(process: Process) -> str:
    """A process, with those that share it."""
    return f"{process.name} ({', '.join(process.instances)})" if process.members else process.name


def _can_show(text: str, encoding: str) -> bool:
    try:
        text.encode(encoding)
    except (UnicodeEncodeError, LookupError):
        return False
    return True
