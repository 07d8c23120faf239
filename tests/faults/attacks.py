"""Rows about other hosts' programs that try to take more than their share: of memory, of time, of descriptors."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import partial

from ..freeports import free_ports
from .checker import Violation
from .history import Asked, Ended, Event
from .laboratory import Laboratory, Remote, until
from .rows import Figure, Result, Row, Run

_CHANNEL, _TOPIC = "faults/Conformance/op", "faults/Conformance/topic"

_FILES = 1024
"""Descriptors that the process may have whose descriptors are attacked."""

_PACE = 0.002
"""Seconds between two calls of the neighbour."""

_NOTICED = 5.0
"""Seconds in which a process notices that connections have ended."""


def _attacked(run: Run, what: str, megabytes: float) -> Result:
    """A neighbour calls a server all the time; a stranger attacks that server; a newcomer calls it meanwhile.

    All of them share this machine. So the stranger first attacks another server, which has no client: what the
    neighbour notices then is the load of the machine, and what it notices later is compared with that.
    """
    seconds = 10.0 if run.full else 2.0
    port, other_port = free_ports(2)
    target = _TOPIC if what == "subscriptions" else _CHANNEL
    with run.laboratory() as laboratory:
        other, server = (_server(laboratory, *each, what) for each in (("other", other_port), ("server", port)))
        neighbour, stranger = (_elsewhere(laboratory, name, port) for name in ("neighbour", "stranger"))
        neighbour.ask(channel=_CHANNEL, calls=10**9, pace=_PACE)
        until(lambda: neighbour.well(channel=_CHANNEL) > 10, 30.0, "the neighbour is answered")
        quiet = time.monotonic(), _pass(seconds)
        rival = _elsewhere(laboratory, "rival", other_port)
        rival.attack(what=what, channel=target, seconds=seconds)
        beside = time.monotonic(), _ended(rival, seconds)
        other.stop(channel=_TOPIC)
        before, lines = server.usage(), laboratory.log("server").count("\n")
        stranger.attack(what=what, channel=target, seconds=seconds)
        begun = time.monotonic()
        newcomer = _elsewhere(laboratory, "newcomer", port)
        arrived = time.monotonic()
        newcomer.ask(channel=_CHANNEL, calls=10**9, pace=0.01)  # Unreachable until it has found the server
        until(lambda: newcomer.well(channel=_CHANNEL) > 0, 30.0, "a newcomer is answered")
        waited = time.monotonic() - arrived
        newcomer.stop(channel=_CHANNEL)
        done = stranger.wait(channel="attack", timeout=seconds + 60.0)
        ended = time.monotonic()
        after, logged = server.usage(), laboratory.log("server").count("\n") - lines
        files_kept = _files_soon(server, before["files"] + 20) - before["files"]
        served = newcomer.ask_once(channel=_CHANNEL)
        neighbour.stop(channel=_CHANNEL)
        server.stop(channel=_TOPIC)
        history = laboratory.end()
    own = [event for event in history if getattr(event, "at", quiet[0]) >= quiet[0]]
    usual, loaded, meanwhile = _p99(own, *quiet), _p99(own, *beside), _p99(own, begun, ended)
    figures = [
        Figure("sent", done["sent"] / 1e6, "MB")
        if what in ("message", "subscriptions")
        else Figure("sent", done["sent"]),
        Figure("memory grew at most", (after["peak"] - before["memory"]) / 1e6, "MB", megabytes),
        Figure("descriptors afterwards", files_kept, "", 20 if what != "silent" else _FILES // 2),
        Figure("log lines", logged, "", 10),
        Figure("a neighbour's p99 before", usual * 1000, "ms"),
        Figure("its p99 while another server is attacked", loaded * 1000, "ms"),
        Figure("p99 of other clients, relative", meanwhile / (max(usual, loaded) or 1.0), "", 2, timed=True),
        Figure("first reply to a new client", waited, "s", 1, timed=True),
    ]
    violations = run.check(history)
    if served != "server":
        violations.append(Violation(what, "a newcomer is not served"))
    if not done["closed"] and what in ("message", "subscriptions"):
        violations.append(Violation(what, "the stranger was never cut off"))
    violations += [Violation(what, f"a neighbour's call ended as {event.outcome}") for event in own if _failed(event)]
    return Result(figures, violations)


def _server(laboratory: Laboratory, name: str, port: int, what: str) -> Remote:
    """An actor that serves and publishes on a port of its own, out of sight of the others."""
    server = laboratory.start(name, options={"bind": f"tcp://127.0.0.1:{port}"}, run=name)
    if what == "silent":
        server.limit_files(count=_FILES)
    server.serve(channel=_CHANNEL)
    server.publish(channel=_TOPIC, count=10**9, pace=0.1)
    return server


def _ended(stranger: Remote, seconds: float) -> float:
    """Wait until the attack is over; when that was."""
    stranger.wait(channel="attack", timeout=seconds + 60.0)
    return time.monotonic()


def _elsewhere(laboratory: Laboratory, name: str, port: int) -> Remote:
    """An actor that reaches the server over TCP only, as from another host."""
    return laboratory.start(name, options={"connect": {"server": f"tcp://127.0.0.1:{port}"}}, run=name)


def _pass(seconds: float) -> float:
    """Wait so long; when that was over."""
    time.sleep(seconds)
    return time.monotonic()


def _files_soon(server: Remote, most: int) -> int:
    """How many descriptors a process has, once it has at most so many, or after `_NOTICED` seconds."""
    end = time.monotonic() + _NOTICED
    while (files := int(server.usage()["files"])) > most and time.monotonic() < end:
        _pass(0.1)
    return files


def _failed(event: Event) -> bool:
    return isinstance(event, Ended) and event.call.startswith("neighbour.") and event.outcome != "ok"


def _p99(history: Sequence[Event], begin: float, end: float) -> float:
    """Of what the neighbour's calls took that were made then, in seconds."""
    asked = {event.call: event.at for event in history if isinstance(event, Asked) and begin <= event.at < end}
    ended = [event for event in history if isinstance(event, Ended) and event.call in asked]
    took = sorted(event.at - asked[event.call] for event in ended if event.call.startswith("neighbour."))
    return took[int(len(took) * 0.99)] if took else 0.0


def _row(name: str, fault: str, megabytes: float) -> Row:
    neighbours = "calls of other clients succeed; their p99 ≤ 2 × that with another server attacked"
    must = f"memory ≤ {megabytes:g} MB more; {neighbours if name == 'message' else 'other clients as for message'}"
    run: Callable[[Run], Result] = partial(_attacked, what=name, megabytes=megabytes)
    return Row(name, fault, must, ("zeromq",), 25, run)


ROWS = [
    _row("message", "one connection sends a message that never ends", 450),
    _row("subscriptions", "one connection makes random subscriptions", 150),
    _row("bombs", "six payloads at a time that would be a hundred times as large when decoded", 450),
    _row("silent", "3,000 silent connections to a server with 1,024 descriptors", 50),
]
