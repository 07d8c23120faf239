"""`rc top`: what components and their operations do now."""

from __future__ import annotations

import argparse
import json
import math
import re
import sys
import time
from collections.abc import Iterator, Sequence, Set
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

from .common import FINE, WRONG, sleep_while_read
from .completing import What, completed
from .hosts import HERE, add_hosts, code_of, hosts_of
from .live import COMPONENT, EXIT_STATUS, Absent, add_json, add_middleware, components_named, positive, reported

if TYPE_CHECKING:
    from rich.text import Text

    from ..tools.access import Access
    from ..tools.hosts import Hosts
    from ..tools.measure import Load, Operation
    from ..tools.network import Network

NAME = "top"

_EXAMPLES = f"""\
examples:
  rc top                     all components on this host, once a second, until Ctrl-C
  rc top world wander        only these, each with its operations
  rc top --once              one table and no more: averages since each component was started
  rc top --once --json       the same for machines: one component a line, with all its operations

Durations are those of the latest 256 messages or calls: for a client the round trip, for a server or a subscriber the
run of its handler, for a publisher the time in `send`. `wait` is the longest time before a handler ran.
`no answer`: a component runs and does not answer, for example because its process is stopped; `rc doctor` tells more.
`not heard`: nothing subscribes to a topic, so that a component may not publish there, as scenes do (`--all`).
Components that share a process show the processor and the memory of all of them. Memory that several processes share,
as that of the interpreter, counts whole for each of them; `rcdeploy status` counts it in part.

{EXIT_STATUS}
"""


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description = (
        "Show what components do: processor, memory, calls of compute, messages a second, durations, failures, losses. "
        "They answer this themselves, so that a component of RoboComp or of another language is not shown."
    )
    to.epilog = _EXAMPLES
    completed(to.add_argument("components", nargs="*", metavar="COMPONENT", help=COMPONENT), What.COMPONENT)
    to.add_argument("--once", action="store_true", help="print one table and end")
    to.add_argument("--all", action="store_true", help="also operations that nothing uses")
    to.add_argument(
        "--every", type=positive, default=1.0, metavar="SECONDS", help="the time between two looks (default: 1)"
    )
    to.add_argument("--for", dest="seconds", type=positive, metavar="SECONDS", help="end after this time")
    add_hosts(to)
    add_middleware(to)
    add_json(to)


def run(options: argparse.Namespace) -> int:
    from ..tools.access import Access

    with reported("rc top") as code, hosts_of(options) as hosts, Access() as access:
        looks = _looks(access, options, hosts)
        if options.once or options.json or not sys.stdout.isatty():
            for found in looks:
                _print(found, options, with_hosts=bool(hosts.posts))
            return code_of(hosts)
        return code_of(hosts, _live(looks, options, with_hosts=bool(hosts.posts)))
    return code()


def _looks(access: Access, options: argparse.Namespace, hosts: Hosts) -> Iterator[list[Load]]:
    """What there is, one look after the other. Raises Absent if nothing tells at the first."""
    from ..tools import asking
    from ..tools.lookout import Rounds

    rounds = Rounds(access)
    begun, number = time.monotonic(), 0
    while True:
        network = hosts.census(options.middleware)
        names = components_named(asking.components(network), options.components)
        told = rounds.ask(network, names, min(asking.DEADLINE, max(options.every, 0.2)))
        if not names and not number:
            raise Absent("no component here tells what it does; `rc list` shows what runs")
        where = asking.hosts(network)
        heard = {each.name for each in network.channels.values() if each.users}
        loads = [mark_unheard(told[name].now, heard) if name in told else silent(network, name) for name in names]
        yield [replace(each, host=where.get(each.component, "")) for each in loads]
        number += 1
        if options.once or (options.seconds and time.monotonic() - begun >= options.seconds):
            return
        sleep_while_read(max(0.0, begun + number * options.every - time.monotonic()))


def mark_unheard(load: Load, heard: Set[str]) -> Load:
    """Mark the topics without a subscriber; `heard` are the channels that have one."""
    operations = [
        replace(each, is_heard=each.channel in heard) if each.verb == "publishes" else each for each in load.operations
    ]
    return replace(load, operations=tuple(operations))


def silent(network: Network, name: str) -> Load:
    """The row of a component that does not answer, for example because its process is stopped."""
    from ..tools.measure import Load

    its = (each for each in network.stock("Introspection") if each.name.startswith(f"{name}/Introspection/"))
    pid = next((end.told.pid for channel in its for end in channel.providers), 0)
    return Load(name, NO_ANSWER, "", pid, math.nan, 0, math.nan, 0.0, 0, 0, 0)


def _print(found: Sequence[Load], options: argparse.Namespace, *, with_hosts: bool = False) -> None:
    if options.json:
        for each in found:
            print(json.dumps(_plain(asdict(each))), flush=True)
    else:
        print("\n".join(line.plain.rstrip() for line in lines(found, options, with_hosts=with_hosts)), flush=True)


def _live(looks: Iterator[list[Load]], options: argparse.Namespace, *, with_hosts: bool) -> int:
    from rich.console import Console, Group
    from rich.live import Live

    console = Console(highlight=False)
    found: list[Load] = []
    try:
        with Live(console=console, auto_refresh=False, screen=False, transient=True) as live:
            for found in looks:
                shown = lines(found, options, with_hosts=with_hosts, most=console.width)
                live.update(Group(*shown[: max(1, console.height - 1)]), refresh=True)
    finally:  # also after Ctrl-C: the last table stays on the screen, whole
        for line in lines(found, options, with_hosts=with_hosts) if found else ():
            console.print(line, soft_wrap=True)
    return FINE if found else WRONG


def lines(
    found: Sequence[Load], options: argparse.Namespace, *, with_hosts: bool = False, most: int | None = None
) -> list[Text]:
    """The table of components, then that of operations. Lines of more than `most` characters are shortened."""
    shown = [(each, one) for each in found for one in each.operations if options.all or not one.is_quiet]
    heads = _insert(_COMPONENTS, "host") if with_hosts else _COMPONENTS
    rows = [
        (_insert(_component(each), each.host or HERE) if with_hosts else _component(each), _is_bad(each))
        for each in found
    ]
    table = _table(heads, rows, left=len(heads) - len(_COMPONENTS) + 2, most=most)
    if shown:
        operations = [(_operation(each, one), bool(one.failed or one.lost)) for each, one in shown]
        table += _table(_OPERATIONS, operations, left=1, most=most)
    return table


def _insert(cells: tuple[str, ...], host: str) -> tuple[str, ...]:
    """The host comes behind the component."""
    return cells[0], host, *cells[1:]


_COMPONENTS = (
    *("component", "state", "process", "cpu %", "MB", "compute/s", "msg/s"),
    *("failed", "lost", "queue", "suspended", "overruns"),
)
NO_ANSWER = "no answer"
"""The state of a component that runs and does not answer."""

_NAME = 24
"""Characters of a name that are shown at least, however narrow the terminal is."""
_OPERATIONS = ("operation", "over", "per s", "p50 ms", "p99 ms", "max ms", "wait ms", "failed", "lost", "refused")


def _component(each: Load) -> tuple[str, ...]:
    return (
        each.component,
        each.state,
        str(each.pid or ""),
        _number(each.processor * 100),
        _number(each.memory / 1e6) if each.memory else "",
        _number(each.computes),
        "" if each.state == NO_ANSWER else _number(each.calls),
        *(str(number or "") for number in (each.failed, each.lost, each.queued, each.suspended, each.overruns)),
    )


def _operation(component: Load, each: Operation) -> tuple[str, ...]:
    from ..tools.measure import milliseconds

    arrow = "→" if each.verb in ("requires", "publishes") else "←"
    return (
        f"{component.component} {arrow} {each.channel}",
        each.middleware,
        _number(each.rate) if each.rate or each.is_heard else "not heard",
        *map(milliseconds, (each.p50, each.p99, each.longest, each.waited)),
        *(str(number or "") for number in (each.failed, each.lost, each.refused)),
    )


def _is_bad(each: Load) -> bool:
    return bool(each.failed or each.lost or each.state in ("emergency", NO_ANSWER))


def _table(
    heads: Sequence[str], rows: Sequence[tuple[Sequence[str], bool]], *, left: int, most: int | None
) -> list[Text]:
    """The first `left` columns, and the middleware, are aligned at their left side."""
    from rich.text import Text

    widths = [max(map(len, cells)) for cells in zip(heads, *(cells for cells, _ in rows), strict=True)]
    kept: Sequence[int] = range(len(heads))
    if most and _total(widths) > most:  # empty columns go first, then the beginnings of names
        kept = [number for number in kept if number < left or any(cells[number] for cells, _ in rows)]
        excess = _total([widths[number] for number in kept]) - most
        widths[0] = max(min(widths[0], _NAME), widths[0] - max(0, excess))

    def line(cells: Sequence[str], style: str) -> Text:
        filled = (
            f"{_shortened(cells[number], widths[number]):<{widths[number]}}"
            if number < left or heads[number] == "over"
            else f"{cells[number]:>{widths[number]}}"
            for number in kept
        )
        return Text("  ".join(filled), style=style, no_wrap=True, overflow="crop")

    return [line(heads, "dim"), *(line(cells, "red" if bad else "") for cells, bad in rows)]


def _total(widths: Sequence[int]) -> int:
    return sum(widths) + 2 * (len(widths) - 1)


def _shortened(text: str, width: int) -> str:
    """Without the first letters of a name; those before an arrow stay, if there is room."""
    missing = len(text) - width
    if missing <= 0:
        return text
    before = re.match(r".* [→←] ", text)
    kept = before[0] if before and len(before[0]) <= width // 2 else ""
    return f"{kept}…{text[len(kept) + missing + 1 :]}"


def _number(value: float) -> str:
    if math.isnan(value):
        return ""
    return f"{value:.1f}" if 0 < value < 10 else f"{value:.0f}"


def _plain(value: Any) -> Any:
    """JSON has no NaN."""
    match value:
        case dict():
            return {key: _plain(each) for key, each in value.items()}
        case list() | tuple():
            return [_plain(each) for each in value]
        case float() if not math.isfinite(value):
            return None
    return value
