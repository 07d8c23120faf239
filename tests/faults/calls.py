"""Rows about calls: servers that are killed, restarted and stopped."""

from __future__ import annotations

import random
import threading
import time
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

from .history import Asked, Done, Ended, Event
from .laboratory import Laboratory, Remote, until
from .rows import HERE, WAITING, Figure, Result, Row, Run

_CHANNEL = "faults/Conformance/op{}"

_PAUSE = 0.02
"""Seconds that a handler takes, so that servers can be killed in it."""

_SLOW = ("dds",)
"""Where it takes two seconds until a death is known, so that many die at a time."""


def _killed(run: Run) -> Result:
    kills = run.rounds(1100, 12)  # some come just after the answer
    lanes = (16 if run.full else 4) if run.transport in _SLOW else 4
    with run.laboratory() as laboratory:
        with ThreadPoolExecutor(lanes) as pool:
            each = [kills // lanes + (lane < kills % lanes) for lane in range(lanes)]
            done = _Progress(run, kills)
            try:
                list(
                    pool.map(
                        lambda lane: _kill_again_and_again(laboratory, run.seed, lane, each[lane], done), range(lanes)
                    )
                )
            finally:
                done.over = True  # also when one of them failed, or the test was interrupted
        history = laboratory.end()
    slowest, outcomes, hit = _after_kills(history)
    limit = 2.5 if run.transport in ("dds", "shm") else 1.0
    figures = [
        Figure("kills in a call", hit),
        Figure("slowest outcome", slowest, "s", limit, timed=True),
        *(Figure(outcome, count) for outcome, count in sorted(outcomes.items())),
    ]
    return Result(figures, run.check(history))


class _Progress:
    def __init__(self, run: Run, total: int) -> None:
        self._run, self._total, self._lock, self._done = run, total, threading.Lock(), 0
        self.over = False

    def one_more(self) -> None:
        with self._lock:
            self._done += 1
            if self._run.full and self._done % (self._total // 10) == 0:
                self._run.tell(f"{self._done} of {self._total}")


def _kill_again_and_again(laboratory: Laboratory, seed: int, lane: int, kills: int, done: _Progress) -> None:
    """Lanes 0 and 1 ask what is not idempotent, by `ask` and by `call`; 2 and 3 what is, and so on."""
    chance, channel = random.Random(f"{seed} {lane}"), _CHANNEL.format(lane)
    idempotent, how = lane % 4 >= 2, "call" if lane % 2 else "ask"
    client = laboratory.start(f"c{lane}")
    server = _serving(laboratory, f"s{lane}.0", channel, idempotent)
    client.ask(channel=channel, calls=10**9, idempotent=idempotent, how=how)
    for number in range(1, kills + 1):
        if done.over:
            return
        # The first one may have been asked before: it is to be answered now. One in ten may be asked again.
        for _ in range(12 if idempotent else 2):
            _wait_for_a_call(laboratory, server)
        time.sleep(chance.uniform(0.0, 0.75 * _PAUSE))
        server.kill()
        server = _serving(laboratory, f"s{lane}.{number}", channel, idempotent)
        done.one_more()
    _wait_for_a_call(laboratory, server)
    client.stop(channel=channel)


def _serving(laboratory: Laboratory, name: str, channel: str, idempotent: bool = False) -> Remote:
    server = laboratory.start(name)
    server.serve(channel=channel, pause=_PAUSE, idempotent=idempotent)
    return server


def _wait_for_a_call(laboratory: Laboratory, server: Remote) -> None:
    """Until one more has begun there."""
    before = server.written()
    until(lambda: server.written() > before, 30.0, f"a call of {server.name}")


def _after_kills(history: Sequence[Event]) -> tuple[float, Counter[str], int]:
    """The longest time from a kill to the end of the call that it hit, how these ended, and how many there were.

    Calls of idempotent operations last until the next server answers, or their deadline.
    """
    asked = {event.call: event for event in history if isinstance(event, Asked)}
    kills = sorted((event.at, event.whom) for event in history if isinstance(event, Done) and event.what == "kill")
    slowest, outcomes, hit = 0.0, Counter[str](), 0
    for end in history:
        if not isinstance(end, Ended):
            continue
        call = asked[end.call]
        lane = call.call.partition(".")[0].replace("c", "s", 1) + "."
        for at, whom in kills:
            if whom.startswith(lane) and call.at < at < end.at:
                hit += 1
                kind = "idempotent, " if call.kind == "idempotent" else ""
                outcomes[kind + end.outcome] += 1
                if call.kind != "idempotent":
                    slowest = max(slowest, end.at - at)
                break
    return slowest, outcomes, hit


def _restarted(run: Run) -> Result:
    cycles, channel = run.rounds(200, 5), _CHANNEL.format(0)
    with run.laboratory() as laboratory:
        client = laboratory.start("c0")
        client.ask(channel=channel, calls=10**9, pace=0.01)
        ready: dict[str, float] = {}
        before: dict[str, int] = {}
        for cycle in range(cycles + 3):
            server = _serving(laboratory, f"s0.{cycle}", channel)
            ready[server.name] = time.monotonic()
            for _ in range(3):  # when the third one begins, the first two have been answered
                _wait_for_a_call(laboratory, server)
            if cycle == 2:
                before = client.usage()
            server.end()
            until(lambda server=server: not server.alive(), 10.0, f"{server.name} ends")
            if run.full and cycle % (cycles // 10) == 0:
                run.tell(f"{cycle} of {cycles}")
        server = _serving(laboratory, "s0.last", channel)
        _wait_for_a_call(laboratory, server)
        after = _settled(client, before)
        client.stop(channel=channel)
        history = laboratory.end()
    first: dict[str, float] = {}
    for event in history:
        if isinstance(event, Ended) and event.outcome == "ok":
            first[event.server] = min(event.at, first.get(event.server, event.at))
    waits = [max(0.0, first[name] - at) for name, at in ready.items() if name in first]
    threads, files = _grown(before, after)
    figures = [
        Figure("cycles", cycles),
        Figure("first good call", max(waits), "s", 1.5, timed=True),
        Figure("more threads", threads, "", 0),
        Figure("more files", files, "", 0),
        Figure("memory grew", (after["memory"] - before["memory"]) / 1e6, "MB", 30),
    ]
    return Result(figures, run.check(history))


def _settled(client: Remote, before: dict[str, int]) -> dict[str, int]:
    """What it uses when what belonged to the last server is gone; that may take a while, but not long."""
    end = time.monotonic() + 10.0
    while True:
        after: dict[str, int] = client.usage()
        if max(_grown(before, after)) <= 0 or time.monotonic() > end:
            return after
        time.sleep(0.1)


def _grown(before: dict[str, int], after: dict[str, int]) -> tuple[int, int]:
    return after["threads"] - before["threads"], after["files"] - before["files"]


def _stopped(run: Run) -> Result:
    """A server is stopped and goes on, a few times, under calls with a deadline of half a second."""
    rounds, deadline, channel = run.rounds(20, 2), 0.5, _CHANNEL.format(0)
    longest = 6 * deadline if run.full else WAITING + 3 * deadline  # or what is executed after it would not be late
    off = []
    with run.laboratory() as laboratory:
        server = _serving(laboratory, "s0", channel)
        clients = [laboratory.start(f"c{number}") for number in range(2)]
        for number, client in enumerate(clients):
            client.ask(channel=channel, calls=10**9, deadline=deadline, how=("ask", "call")[number])
        for number in range(rounds):
            _wait_for_a_call(laboratory, server)
            server.freeze()
            time.sleep(3 * deadline if number % 2 else longest)
            server.thaw()
            run.tell(f"{number + 1} of {rounds}")
        _wait_for_a_call(laboratory, server)
        for client in clients:
            client.stop(channel=channel)
        history = laboratory.end()
    asked = {event.call: event.at for event in history if isinstance(event, Asked)}
    for event in history:
        if isinstance(event, Ended) and event.outcome == "Timeout":
            off.append(event.at - asked[event.call] - deadline)
    figures = [
        Figure("calls that timed out", len(off)),
        Figure("beyond their deadline", max(off, default=0.0) * 1000, "ms", 50, timed=True),
        Figure("before their deadline", -min(off, default=0.0) * 1000, "ms", 50, timed=True),
    ]
    return Result(figures, run.check(history))


def _beside_a_camera(run: Run) -> Result:
    """A client calls at 100 Hz, while a camera publishes images of 6 MB at 20 Hz on the same host."""
    calls, channel, images = run.rounds(3000, 200), _CHANNEL.format(0), "faults/Conformance/images"
    with run.laboratory() as laboratory:
        server, client = laboratory.start("s0"), laboratory.start("c0")
        camera, viewer = laboratory.start("camera"), laboratory.start("viewer")
        server.serve(channel=channel)
        viewer.subscribe(channel=images, depth=1)
        camera.publish(channel=images, count=10**9, pace=0.05, size=6_000_000)
        until(lambda: viewer.written() > 0, 20.0, "the viewer gets an image")
        client.ask(channel=channel, calls=calls, pace=0.01)
        client.wait(channel=channel, timeout=calls * 0.1 + 60.0)
        camera.stop(channel=images)
        history = laboratory.end()
    asked = {event.call: event.at for event in history if isinstance(event, Asked)}
    ended = [event for event in history if isinstance(event, Ended)]
    took = sorted(event.at - asked[event.call] for event in ended)
    figures = [
        Figure("calls", len(ended)),
        Figure("that failed", sum(event.outcome != "ok" for event in ended), "", 0),
        Figure("p99", took[int(len(took) * 0.99)] * 1000, "ms", 20, timed=True),
        Figure("slowest", took[-1] * 1000, "ms"),
    ]
    return Result(figures, run.check(history))


ROWS = [
    Row(
        "camera",
        "calls at 100 Hz beside images of 6 MB at 20 Hz",
        "0 calls fail; p99 ≤ 20 ms",
        HERE,
        45,
        _beside_a_camera,
    ),
    Row(
        "kill",
        "kill -9 of a server in mid-call, 1000 times",
        "typed outcome ≤ 1 s (≤ 2.5 s on DDS and shm), 0 hangs, 0 double executions",
        (*HERE, "ice"),
        120,
        _killed,
    ),
    Row(
        "restart",
        "server restart, client stays, 200 cycles",
        "first good call ≤ 1.5 s after ready; threads and file descriptors back to the start",
        (*HERE, "ice"),
        40,
        _restarted,
    ),
    Row(
        "stop",
        "stopped server (SIGSTOP)",
        "calls end at their deadline ± 50 ms; none is executed after it",
        (*HERE, "ice"),
        46,
        _stopped,
    ),
]
