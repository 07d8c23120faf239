"""The state of a network as a table: a snapshot in, lines of styled text out. No library, so that it is fast.

A line for each process, and below it, if it has several instances, one for each of them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime

from ..version import __version__
from .agents import Life
from .policy import State
from .snapshot import ProcessStatus, Snapshot

Span = tuple[str, str]
"""Text and its style, in rich's words."""
Line = list[Span]

STYLES = {
    State.WAITING: "dim",
    State.STARTING: "yellow",
    State.READY: "green",
    State.HUNG: "bold red",
    State.STOPPING: "yellow",
    State.RESTARTING: "bold yellow",
    State.LOST: "bold red",
    State.ENDED: "dim",
    State.FAILED: "bold red",
}
USUAL = "compute"
"""The state of the life cycle in which a ready component usually is; others are shown."""

_UNUSUAL = "bold red"

HERE = "here"
"""The name of the controller's machine in the column of hosts."""

_GAP = "  "
_LEAST_NOTE = 24
"""Minimum width of the column of notes, in characters; with less room it is left out."""


@dataclass(frozen=True, slots=True)
class _Column:
    title: str
    value: Callable[[ProcessStatus], str]
    to_the_right: bool = True
    leaves: int = 0
    """The order in which columns are left out of long lines: the greatest number first; 0 always stays."""


def summary(snapshot: Snapshot) -> Line:
    """One line about all of it."""
    processes = snapshot.processes
    instances = sum(len(each.instances) for each in processes)
    counted: Counter[State] = Counter()
    for each in processes:
        counted[State.ENDED] += len(each.ended)
        counted[each.state] += len(each.instances) - len(each.ended)
    states = [(f"{number} {state}", STYLES[state]) for state, number in _in_order(counted)]
    unusual = Counter(filter(None, (_unusual(each, name) for each in processes for name in each.instances)))
    states += [(f"{number} in {state}", _UNUSUAL) for state, number in unusual.items()]
    lost = [host for host in snapshot.hosts if not host.reachable]
    line: Line = [(snapshot.network, "bold"), (f": {instances} {'component' if instances == 1 else 'components'}", "")]
    for said, style in states:
        line += [(", ", ""), (said, style)]
    line.append((f", up {duration(snapshot.uptime)}", ""))
    if snapshot.stopping:
        line.append((f"; stopping: {snapshot.why}" if snapshot.why else "; stopping", "bold yellow"))
    for host in lost:
        line.append((f"; host {host.name} is out of reach: {host.why}", "bold red"))
    return line


def table(
    snapshot: Snapshot,
    *,
    width: int | None = None,
    height: int | None = None,
    colours: Mapping[str, str] | None = None,
) -> list[Line]:
    """All processes, or those that fit into `height` lines; healthy ones are left out first, and counted.

    The least important columns are left out if lines would be longer than `width`.
    """
    processes, others = _worth_a_line(snapshot.processes, height)
    columns = [each for each in _COLUMNS if each.title in ("instance", "state") or any(map(each.value, processes))]
    if not snapshot.hosts:
        columns = [each for each in columns if each.title != "host"]
    cells = {column: [column.title, *map(column.value, processes)] for column in columns}
    for process in processes:
        for name in process.instances if _is_shared(process) else ():
            cells[columns[0]].append(f"  {name}")  # counts for the width; its line is made below
    widths = {column: max(map(len, texts)) for column, texts in cells.items()}
    note = columns[-1] if columns[-1].title == _NOTE.title else None
    if width is not None:
        _leave_out(columns, widths, note, width)
    lines = [_line([(column.title, column, "dim") for column in columns], widths)]
    for process in processes:
        style = _UNUSUAL if _state(process) != str(process.state) else STYLES[process.state]
        name = (colours or {}).get(process.name, "")
        lines.append(
            _line([(column.value(process), column, _style(column, name, style)) for column in columns], widths)
        )
        lines += [_member(process, each, columns, widths, name) for each in process.instances if _is_shared(process)]
    if others:
        lines.append([(_more(others), "dim")])
    return lines


def ports(ways: Iterable[Mapping[str, str]]) -> list[Line]:
    """The ports of a network's instances that are linked, with the instances at the other end.

    `ways` are those of its plan, as JSON.
    """
    peers: dict[tuple[str, str, str, str], dict[str, None]] = {}
    for way in ways:
        client, provider, verb, over = way["client"], way["provider"], way["verb"], way["middleware"]
        peers.setdefault((client, verb, way["port"], over), {})[provider] = None
        peers.setdefault((provider, _OTHER_END[verb], way["interface"], over), {})[client] = None
    heads = ("instance", "port", "peers", "over")
    rows = [(instance, f"{verb} {port}", ", ".join(peers[key]), over)
            for key in sorted(peers) for instance, verb, port, over in (key,)]  # fmt: skip
    widths = [max(map(len, cells)) for cells in zip(heads, *rows, strict=True)]

    def line(cells: Sequence[str], style: str) -> Line:
        return [(_GAP.join(f"{cell:<{width}}" for cell, width in zip(cells, widths, strict=True)).rstrip(), style)]

    return [line(heads, "dim"), *(line(row, "") for row in rows)] if rows else []


_OTHER_END = {"requires": "implements", "subscribesTo": "publishes"}


def text(line: Line) -> str:
    return "".join(part for part, _ in line)


# Values.


def duration(seconds: float) -> str:
    """`4 s`, `3:07`, `2:03:07`, `5 d 02:03`."""
    whole = int(seconds)
    minutes, hours = whole // 60, whole // 3600
    if whole < 60:
        return f"{whole} s"
    if hours < 1:
        return f"{minutes}:{whole % 60:02}"
    if hours < 24:
        return f"{hours}:{minutes % 60:02}:{whole % 60:02}"
    return f"{hours // 24} d {hours % 24:02}:{minutes % 60:02}"


def clock_time(at: float) -> str:
    """`12:34:56.789`, of seconds since the Unix epoch, as clocks show it here."""
    return f"{datetime.fromtimestamp(at):%H:%M:%S.%f}"[:-3]


def full_time(at: float) -> str:
    """`2026-03-01 12:34:56.789`."""
    return f"{datetime.fromtimestamp(at):%Y-%m-%d %H:%M:%S.%f}"[:-3]


def memory(size: int) -> str:
    """`812 kB`, `45 MB`, `1.2 GB`."""
    for unit, power in (("GB", 1e9), ("MB", 1e6)):
        if size >= power:
            value = size / power
            return f"{value:.1f} {unit}" if value < 10 else f"{value:.0f} {unit}"
    return f"{size / 1e3:.0f} kB"


def rate(value: float) -> str:
    return f"{value:.1f}" if 0 < value < 10 else f"{value:.0f}"


def milliseconds(seconds: float) -> str:
    value = seconds * 1000
    return f"{value:.2f} ms" if value < 1 else f"{value:.1f} ms" if value < 100 else f"{value:.0f} ms"


def _note(process: ProcessStatus) -> str:
    if process.next_start is not None:
        again = f"again in {process.next_start:.1f} s"
        return f"{process.how}; {again}" if process.how else again
    return process.how or process.status


def _unusual(process: ProcessStatus, instance: str) -> str:
    """The state of the life cycle of a ready component, if it is not the usual one: `emergency`."""
    life = process.lives.get(instance) if process.state is State.READY and instance not in process.ended else None
    return life.state if life and life.state != USUAL else ""


def _state(process: ProcessStatus) -> str:
    """Of a process with several components, theirs are shown below it."""
    own = "" if _is_shared(process) else _unusual(process, process.instances[0])
    return own or str(process.state)


def _sum(process: ProcessStatus, of: Callable[[Life], int]) -> str:
    return str(sum(map(of, process.lives.values())) or "")


def _versions(process: ProcessStatus) -> str:
    """The versions of robocomp_py that differ from our own."""
    return ", ".join(sorted({life.version for life in process.lives.values()} - {__version__}))


def _maybe(form: Callable[[float], str], value: float | None) -> str:
    return "" if value is None else form(value)


_NOTE = _Column("", _note, to_the_right=False)
_COLUMNS = (
    _Column("instance", lambda each: each.name, to_the_right=False),
    _Column("host", lambda each: each.host or HERE, to_the_right=False, leaves=3),
    _Column("state", lambda each: _state(each), to_the_right=False),
    _Column("pid", lambda each: str(each.pid or ""), leaves=6),
    _Column("uptime", lambda each: _maybe(duration, each.uptime), leaves=5),
    _Column("restarts", lambda each: str(each.restarts), leaves=2),
    _Column("cpu", lambda each: _maybe(lambda cores: f"{cores * 100:.0f} %", each.cpu), leaves=1),
    _Column("memory", lambda each: memory(each.memory) if each.memory else "", leaves=4),
    _Column("calls/s", lambda each: rate(each.calls) if each.calls else "", leaves=7),
    _Column("worst", lambda each: milliseconds(each.worst) if each.worst else "", leaves=8),
    _Column("overruns", lambda each: _sum(each, lambda life: life.overruns), leaves=9),
    _Column("missed", lambda each: _sum(each, lambda life: life.missed), leaves=10),
    _Column("lost", lambda each: _sum(each, lambda life: life.lost), leaves=11),
    _Column("version", lambda each: _versions(each), to_the_right=False, leaves=12),
    _NOTE,
)


# Lines.


def _worth_a_line(
    processes: Sequence[ProcessStatus], height: int | None
) -> tuple[Sequence[ProcessStatus], Sequence[ProcessStatus]]:
    """The processes that there is room for, in their order, and the others."""
    if height is None or 1 + sum(map(_height, processes)) <= height:
        return processes, ()
    room = height - 2  # for the heads, and the line that counts the rest
    shown: set[str] = set()
    for each in sorted(processes, key=_urgency):
        if _height(each) <= room:
            shown.add(each.name)
            room -= _height(each)
    return [each for each in processes if each.name in shown], [each for each in processes if each.name not in shown]


_URGENT = (
    State.FAILED, State.HUNG, State.LOST, State.RESTARTING, State.STARTING, State.STOPPING, State.READY, State.WAITING,
    State.ENDED,
)  # fmt: skip


def _urgency(process: ProcessStatus) -> tuple[float, float]:
    """Failed processes first, then restarted ones, then those that use most."""
    unusual = any(_unusual(process, name) for name in process.instances)
    return _URGENT.index(process.state) - 0.5 * unusual, -process.restarts - (process.cpu or 0.0)


def _height(process: ProcessStatus) -> int:
    return 1 + (len(process.instances) if _is_shared(process) else 0)


def _is_shared(process: ProcessStatus) -> bool:
    return process.instances != (process.name,)


def _leave_out(columns: list[_Column], widths: dict[_Column, int], note: _Column | None, width: int) -> None:
    """Shorten lines: first the notes, as far as they stay readable, then whole columns."""

    def room() -> int:
        return width - sum(widths[each] + len(_GAP) for each in columns if each is not note) + len(_GAP)

    wanted = min(widths[note], _LEAST_NOTE) + len(_GAP) if note else 0
    while room() < wanted and any(each.leaves for each in columns):
        columns.remove(max(columns, key=lambda each: each.leaves))
    if note:
        widths[note] = max(0, room() - len(_GAP))
    widths[columns[0]] = max(1, widths[columns[0]] + min(0, room()))


def _line(cells: Sequence[tuple[str, _Column, str]], widths: Mapping[_Column, int]) -> Line:
    line: Line = []
    for number, (cell, column, style) in enumerate(cells):
        width = widths[column]
        shown = cell if len(cell) <= width else cell[: width - 1] + "~" if width else ""
        filled = f"{shown:>{width}}" if column.to_the_right else f"{shown:<{width}}"
        line += [(filled, style), (_GAP, "")] if number < len(cells) - 1 else [(filled.rstrip(), style)]
    while len(line) > 1 and not line[-1][0].strip():
        line.pop()
    return line


def _style(column: _Column, name: str, state: str) -> str:
    if column is _COLUMNS[0]:
        return name
    return state if column.title == "state" or column is _NOTE else ""


def _member(
    process: ProcessStatus, name: str, columns: Sequence[_Column], widths: Mapping[_Column, int], style: str
) -> Line:
    """An instance that shares its process."""
    state = State.ENDED if name in process.ended else process.state
    unusual = _unusual(process, name)
    shown = (unusual, _UNUSUAL) if unusual else (str(state), STYLES[state])
    said = {"instance": (f"  {name}", style), "state": shown}
    cells = [(*said.get(column.title, ("", "")), column) for column in columns]
    return _line([(cell, column, how) for cell, how, column in cells], widths)


def _more(others: Sequence[ProcessStatus]) -> str:
    counted = ", ".join(f"{number} {state}" for state, number in _in_order(Counter(each.state for each in others)))
    return f"... and {len(others)} more: {counted}"


def _in_order(counted: Mapping[State, int]) -> list[tuple[State, int]]:
    return [(state, counted[state]) for state in _URGENT if counted.get(state)]
