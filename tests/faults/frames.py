"""Rows about messages: such that are none, and such that are too large."""

from __future__ import annotations

import time

from .checker import Violation
from .laboratory import PATIENCE, Remote, until
from .rows import HERE, Figure, Result, Row, Run

_CHANNEL, _COMMANDS = "faults/Conformance/op", "faults/Conformance/command"
_FRAMES = 100_000


def _fuzzed(run: Run) -> Result:
    count = run.frames or run.rounds(_FRAMES, 2_000)
    with run.laboratory() as laboratory:
        target, honest, hostile = (laboratory.start(name) for name in ("target", "honest", "hostile"))
        target.serve(channel=_CHANNEL, idempotent=True)
        target.take(channel=_COMMANDS)
        honest.ask(channel=_CHANNEL, calls=10**9, pace=0.05)  # Unreachable until it has found the server
        until(lambda: honest.well(channel=_CHANNEL) > 0, PATIENCE, "the honest client is answered")
        before, lines = target.usage(), laboratory.log("target").count("\n")
        hostile.fuzz(channel=_CHANNEL, commands=_COMMANDS, seed=run.seed, count=count)
        seconds = hostile.wait(channel="fuzz", timeout=3600.0)
        malformed = _settled(target)
        logged = laboratory.log("target").count("\n") - lines
        after = target.usage()
        honest.stop(channel=_CHANNEL)
        served = honest.ask_once(channel=_CHANNEL)
        history = laboratory.end()
    violations = [each for each in run.check(history) if "nobody asked for it" not in each.what]  # some frames are good
    if served != "target":
        violations.append(Violation("hangs", "who is honest is not served any more"))
    figures = [
        Figure("frames", count),
        Figure("counted as malformed", malformed),
        Figure("log lines", logged),
        Figure("log lines a second, after the first 20", max(0, logged - 20) / max(1.0, seconds), "", 1),
        Figure("memory grew", (after["memory"] - before["memory"]) / 1e6, "MB", 100),
        Figure("more threads", after["threads"] - before["threads"], "", 8),
    ]
    return Result(figures, violations)


def _settled(target: Remote) -> int:
    """How many it has counted as malformed when it has looked at all of them."""
    counted, since = -1, time.monotonic()
    while time.monotonic() < since + 1.0:
        now = target.stats(channel=_CHANNEL)["malformed"] + target.stats(channel=_COMMANDS)["malformed"]
        if now != counted:
            counted, since = now, time.monotonic()
        time.sleep(0.05)
    return counted


def _oversized(run: Run) -> Result:
    with run.laboratory() as laboratory:
        server, client = laboratory.start("s"), laboratory.start("c")
        server.serve(channel=_CHANNEL)
        client.ask(channel=_CHANNEL, calls=10**9)  # Unreachable until it has found the server
        until(lambda: client.well(channel=_CHANNEL) >= 10, PATIENCE, "the client is answered")
        client.stop(channel=_CHANNEL)
        refused = client.ask_too_much(channel=_CHANNEL)
        again = client.ask_once(channel=_CHANNEL)
        history = laboratory.end()
    violations = run.check(history)
    if "EncodeError" not in refused or "268435456" not in refused:
        violations.append(Violation("oversized", f"it was not refused with the limit, but: {refused}"))
    if again != "s":
        violations.append(Violation("oversized", f"the next call ended as {again}"))
    return Result([Figure("the limit", 256, "MiB")], violations)


ROWS = [
    Row(
        "malformed",
        "10^5 malformed frames per transport (10^6 by `make fuzz`)",
        "0 crashes, 0 hangs, ≤ 1 log line/s",
        (*HERE, "ice"),
        8,
        _fuzzed,
        frames=_FRAMES,
    ),
    Row(
        "oversized",
        "oversized payload",
        "refused at the sender with the limit; connection survives",
        HERE,
        1,
        _oversized,
    ),
]
