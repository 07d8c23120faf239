"""Rows about what lies between two hosts, which are network namespaces: cuts, losses, and an end that is gone.

One host serves, takes commands and publishes; the other one calls, commands and subscribes.
"""

from __future__ import annotations

import contextlib
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from tests.deploy.laboratory import Host
from tests.deploy.laboratory import Laboratory as Network

from .checker import check_commands
from .history import Asked, Ended, Event, Executed, Heard
from .laboratory import Laboratory, Remote, until
from .rows import Figure, Result, Row, Run

_NETWORKED = ("zeromq", "zenoh", "dds")
_CALLS, _COMMANDS, _TOPIC = "faults/Conformance/op", "faults/Conformance/command", "faults/Conformance/topic"

OWN_CLOCK = ("unshare", "-m", "sh", "-c", 'mount --bind "$0" /proc/sys/kernel/random/boot_id && exec "$@"')
"""Namespaces of one machine have one clock, and are told so by this file; hosts are not."""

_DEADLINE = 1.0
"""Seconds, of calls and of commands."""

_ON_THE_WAY = 3.0
"""Seconds for which a request may lie between two hosts: then the link has been given up, and what was in it."""


@dataclass
class _Two:
    laboratory: Laboratory
    there: Host
    server: Remote
    client: Remote

    def begin(self, pace: float) -> None:
        self.server.serve(channel=_CALLS)
        self.server.take(channel=_COMMANDS)
        self.client.subscribe(channel=_TOPIC, depth=1000)
        self.client.ask(channel=_CALLS, calls=10**9, deadline=_DEADLINE, pace=pace)
        self.client.command(channel=_COMMANDS, calls=10**9, deadline=_DEADLINE, pace=pace)
        self.server.publish(channel=_TOPIC, count=10**9, pace=0.01)
        until(lambda: self.outcomes()["ok"] > 20, 30.0, "calls and commands pass")
        until(lambda: any(isinstance(event, Heard) for event in self.history()), 30.0, "the topic is heard")

    def history(self) -> list[Event]:
        return self.laboratory.history()

    def outcomes(self) -> Counter[str]:
        return Counter(event.outcome for event in self.history() if isinstance(event, Ended))

    def end(self) -> list[Event]:
        """Have all be quiet, and counted; what happened."""
        self.client.stop(channel=_CALLS)
        self.client.stop(channel=_COMMANDS)
        self.client.command(channel=_COMMANDS, calls=20, deadline=_DEADLINE, pace=0.05)
        self.client.wait(channel=_COMMANDS)
        time.sleep(1.0)
        self.server.stop(channel=_TOPIC)
        time.sleep(1.0)
        self.server.stats(channel=_COMMANDS, count=True)
        self.client.stats(channel=_TOPIC, count=True)
        return self.laboratory.end()


@contextlib.contextmanager
def _two_hosts(run: Run) -> Iterator[_Two]:
    with contextlib.ExitStack() as everything:
        network = everything.enter_context(Network())
        here, there = network.host("here"), network.host("there")
        options: list[dict[str, Any]] = [{}, {}]
        match run.transport:
            case "dds":
                options = [{"interface": "eth0"}] * 2
            case "zenoh":
                from robocomp_py.transports.zenoh.session import open_router

                endpoint = f"tcp/{network.address}:7447"
                everything.callback(open_router(endpoint).close)
                options = [{"connect": endpoint}] * 2
            case "zeromq":
                address = f"tcp://{here.address}:5555"
                options = [{"bind": address}, {"connect": {"server": address}}]
        laboratory = everything.enter_context(Laboratory(run.transport, {"connect": "-"}))
        server = laboratory.start("server", prefix=tuple(here.command()), options=options[0], run="run-here")
        boot = laboratory.folder / "boot_id"
        boot.write_text("00000000-0000-0000-0000-000000000000\n")
        client = laboratory.start(
            "client", prefix=(*there.command(), *OWN_CLOCK, str(boot)), options=options[1], run="run-there"
        )
        yield _Two(laboratory, there, server, client)


def _cut(run: Run) -> Result:
    seconds, commands = run.rounds(10, 3), run.rounds(10_000, 300)
    with _two_hosts(run) as two:
        two.begin(pace=0.002)
        until(lambda: two.client.well(channel=_COMMANDS) > commands / 3, 300.0, "a third of the commands")
        two.there.partition()
        cut = two.laboratory.done("cut", "client")
        time.sleep(seconds)
        two.there.heal()
        healed = two.laboratory.done("heal", "client")
        run.tell(f"healed after {seconds} s")
        until(lambda: _first_good(two.history(), healed) is not None, 60.0, "a good call after that")
        until(lambda: two.client.well(channel=_COMMANDS) >= commands, 300.0, "the rest of the commands")
        time.sleep(3.0)
        history = two.end()
    known = _first(history, "Unreachable", cut)
    back = _first_good(history, healed)
    assert back is not None
    return Result(
        [
            *_counts(history),
            Figure("loss noticed after", (known or healed) - cut, "s", 2.5, timed=True),
            Figure("healed after", back - healed, "s", 3, timed=True),
            Figure("executed late at most", _latest(history), "s"),
        ],
        [*run.check(history, late=_ON_THE_WAY), *check_commands(history, "server")],
    )


def _lossy(run: Run) -> Result:
    commands = run.rounds(10_000, 300)
    with _two_hosts(run) as two:
        two.begin(pace=0.002)
        two.there.lose(5)
        until(lambda: two.client.well(channel=_COMMANDS) >= commands, 1200.0, "all commands")
        two.there.heal()
        history = two.end()
    return Result(
        [*_counts(history), Figure("executed late at most", _latest(history), "s")],
        [*run.check(history, late=_ON_THE_WAY), *check_commands(history, "server")],
    )


def _half_open(run: Run) -> Result:
    """The far end is cut off, and then gone, without any message."""
    with _two_hosts(run) as two:
        two.begin(pace=0.01)
        two.there.partition()
        cut = two.laboratory.done("cut", "client")
        two.server.kill()
        until(lambda: _first(two.history(), "Unreachable", cut) is not None, 60.0, "it is known")
        two.there.heal()
        two.client.stop(channel=_CALLS)
        two.client.stop(channel=_COMMANDS)
        history = two.laboratory.end()
    known = _first(history, "Unreachable", cut)
    assert known is not None
    asked = {event.call: event for event in history if isinstance(event, Asked)}
    late = [
        event.at - asked[event.call].at - _DEADLINE
        for event in history
        if isinstance(event, Ended) and event.outcome == "Timeout" and asked[event.call].kind == "query"
    ]
    return Result(
        [
            Figure("loss noticed after", known - cut, "s", 2.5, timed=True),
            Figure("calls that timed out", len(late)),
            Figure("beyond their deadline", max(late, default=0.0) * 1000, "ms", 50, timed=True),
        ],
        run.check(history, late=_ON_THE_WAY),
    )


def _counts(history: list[Event]) -> list[Figure]:
    kinds = {event.call: event.kind for event in history if isinstance(event, Asked)}
    outcomes = Counter((kinds[event.call], event.outcome) for event in history if isinstance(event, Ended))
    executed = {event.call for event in history if isinstance(event, Executed)}
    well = [e.call for e in history if isinstance(e, Ended) and e.outcome == "ok" and kinds[e.call] == "command"]
    return [
        Figure("commands sent well", len(well)),
        Figure("of these lost, and counted", sum(call not in executed for call in well)),
        Figure("calls that ended well", outcomes["query", "ok"]),
        *(
            Figure(f"as {outcome}", number)
            for (kind, outcome), number in sorted(outcomes.items())
            if kind == "query" and outcome != "ok"
        ),
    ]


def _first(history: list[Event], outcome: str, after: float) -> float | None:
    return min((e.at for e in history if isinstance(e, Ended) and e.outcome == outcome and e.at > after), default=None)


def _first_good(history: list[Event], after: float) -> float | None:
    """When the first query that was asked after that ended well."""
    asked = {event.call: event for event in history if isinstance(event, Asked)}
    good = [e.at for e in history if isinstance(e, Ended) and e.outcome == "ok" and asked[e.call].kind == "query"]
    return min((at for at in good if at > after), default=None)


def _latest(history: list[Event]) -> float:
    """By how much the latest of all was executed after its deadline; 0 if none was."""
    asked = {event.call: event for event in history if isinstance(event, Asked)}
    late = [e.at - asked[e.call].at - asked[e.call].deadline for e in history if isinstance(e, Executed)]
    return max(0.0, max(late, default=0.0))


ROWS = [
    Row(
        "partition",
        "partition of 10 s between two hosts",
        "healed ≤ 3 s; each of 10,000 accepted commands is executed once or counted as lost, none twice; "
        "no false ok of a query; gaps counted exactly",
        _NETWORKED,
        45,
        _cut,
        root=True,
    ),
    Row(
        "loss",
        "5 % loss between two hosts",
        "commands, queries and gaps as for partition",
        _NETWORKED,
        35,
        _lossy,
        root=True,
    ),
    Row(
        "half-open",
        "half-open TCP: the far end is cut off",
        "loss noticed ≤ 2.5 s; calls end at their deadline ± 50 ms",
        _NETWORKED,
        4,
        _half_open,
        root=True,
    ),
]
