"""`rcdeploy`: networks of components, started, watched and stopped."""

from __future__ import annotations

import argparse
import json
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from ..deploy.plan import Overrides, Plan, make_plan
from ..deploy.policy import State
from ..deploy.run import Display, Options, run
from ..dsl.workspace import Workspace
from .common import FINE, USAGE, WRONG, add_include, parser, show

_EXAMPLES = """\
examples:
  rcdeploy net.ddsl                              start everything; Ctrl-C stops it
  rcdeploy net.ddsl --middleware zeromq          ... over that middleware
  rcdeploy net.ddsl --for 30                     ... for half a minute
  rcdeploy net.ddsl --until mission              ... until that instance ends
  rcdeploy net.ddsl --set world.params.step=0.1  set a key of an instance's configuration (*: of all)
  rcdeploy plan net.ddsl                         show what would run, and start nothing

The whole network is checked first; nothing is started while anything is wrong.
Exit status: 0 fine, 1 wrong input or something failed, 2 usage, 130/143 stopped by a signal.
"""

_COLOURS = ("cyan", "green", "yellow", "magenta", "blue", "bright_red", "bright_cyan", "bright_green")
_STYLES = {
    State.WAITING: "dim",
    State.STARTING: "yellow",
    State.READY: "green",
    State.STOPPING: "yellow",
    State.ENDED: "dim",
    State.FAILED: "bold red",
}


def main(arguments: Sequence[str] | None = None) -> int:
    given = list(sys.argv[1:] if arguments is None else arguments)
    planning = given[:1] == ["plan"]
    options = _parser(planning).parse_args(given[1:] if planning else given)
    workspace = Workspace(options.include)
    try:
        overrides = Overrides(options.middleware, tuple(map(_assignment, options.set)))
    except ValueError as exc:
        print(f"rcdeploy: {exc}", file=sys.stderr)
        return USAGE
    plan = make_plan(options.network, workspace, overrides)
    as_json = planning and options.json
    show(workspace.report.diagnostics, as_json=as_json and plan is None)
    if plan is None:
        return WRONG
    if planning:
        _print_plan(plan, as_json)
        return FINE
    if options.until and options.until not in [process.name for process in plan.processes]:
        print(f"rcdeploy: --until {options.until}: there is no such instance", file=sys.stderr)
        return USAGE
    return _run(plan, Options(options.duration, options.until))


def _parser(planning: bool) -> argparse.ArgumentParser:
    name = "rcdeploy plan" if planning else "rcdeploy"
    made = parser(name, "Start, watch and stop a network of components described in DDSL.", _EXAMPLES)
    made.add_argument("network", type=Path, metavar="NET.ddsl")
    made.add_argument("--middleware", metavar="NAME", help="what carries the messages, whatever the network says")
    made.add_argument(
        "--set", action="append", default=[], metavar="INSTANCE.KEY=VALUE", help="set a key; may be repeated"
    )
    add_include(made)
    if planning:
        made.add_argument("--json", action="store_true", help="for machines")
    else:
        made.add_argument(
            "--for", dest="duration", type=_seconds, metavar="SECONDS", help="stop so long after everything was ready"
        )
        made.add_argument("--until", metavar="INSTANCE", help="stop everything when this one ends")
    return made


def _seconds(text: str) -> float:
    value = float(text)
    if not 0 <= value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text} is no number of seconds")
    return value


def _assignment(text: str) -> tuple[str, str]:
    instance, dot, assignment = text.partition(".")
    if not dot or "=" not in assignment or "=" in instance:
        raise ValueError(f"--set {text}: write it as INSTANCE.KEY=VALUE, as in world.component.period=0.02")
    return instance, assignment


def _print_plan(plan: Plan, as_json: bool) -> None:
    if as_json:
        print(json.dumps(plan.to_json(), indent=2))
        return
    console = Console()
    table = Table(title=f"{plan.name} over {plan.middleware or 'what each component was generated for'}")
    for column in ("instance", "component", "starts after", "uses"):
        table.add_column(column)
    for process in plan.processes:
        uses = ", ".join(f"{link.interface} of {link.provider}" for link in plan.links if link.client == process.name)
        table.add_row(process.name, process.component, ", ".join(process.after), uses)
    console.print(table)
    for process in plan.processes:
        console.print(Text(f"{process.name}: {shlex.join(process.command)}", style="dim"), soft_wrap=True)


def _run(plan: Plan, options: Options) -> int:
    if not plan.processes:
        return FINE
    console = Console(highlight=False, soft_wrap=True)
    display = _Terminal(plan, console)
    if not console.is_terminal:
        return run(plan, options, display)
    with Live(display.table({}), console=console, auto_refresh=False, transient=True) as live:
        display.live = live
        return run(plan, options, display)


class _Terminal(Display):
    """Lines with coloured names; on a terminal, a table of all states below them."""

    def __init__(self, plan: Plan, console: Console) -> None:
        self._plan, self._console = plan, console
        names = [process.name for process in plan.processes]
        self._width = max(map(len, names))
        self._colours = {name: _COLOURS[n % len(_COLOURS)] for n, name in enumerate(names)}
        self.live: Live | None = None

    def line(self, name: str, text: str) -> None:
        style = "red" if text.startswith(("ERROR", "CRITICAL")) else "yellow" if text.startswith("WARNING") else ""
        self._console.print(
            Text.assemble((f"{name:>{self._width}} │ ", self._colours[name]), (text.removeprefix("INFO: "), style))
        )

    def states(self, states: dict[str, State]) -> None:
        if self.live:
            self.live.update(self.table(states), refresh=True)

    def up(self) -> None:
        self._say(f"all {len(self._plan.processes)} components of {self._plan.name} are ready", "bold green")

    def died(self, name: str, code: int, last: list[str]) -> None:
        how = f"was ended by signal {-code}" if code < 0 else f"ended with exit code {code}" if code else "has ended"
        self._say(f"{name} {how}", "bold red" if code else "yellow")
        if code and last:
            self._say(f"the last lines of {name}:", "red")
            for text in last:
                self._console.print(Text(f"    {text}", style="red"))

    def stopping(self, why: str) -> None:
        self._say(f"stopping: {why}", "bold")

    def table(self, states: dict[str, State]) -> Group:
        cells = []
        for process in self._plan.processes:
            state = states.get(process.name, State.WAITING)
            cells.append(Text.assemble((process.name, self._colours[process.name]), " ", (str(state), _STYLES[state])))
        return Group(Text("─" * 40, style="dim"), Text("  ").join(cells))

    def _say(self, text: str, style: str) -> None:
        self._console.print(Text(f"{'rcdeploy':>{self._width}} │ {text}", style=style))


if __name__ == "__main__":
    raise SystemExit(main())
