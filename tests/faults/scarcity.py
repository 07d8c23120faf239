"""Rows about a system that has no thread and no file descriptor to spare, for a while.

Root may have any number of threads, so these rows are run by a user of their own if root runs the matrix.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import random
import resource
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from functools import partial

from .checker import Violation
from .laboratory import ROOT, Remote, until
from .rows import HERE, Figure, Result, Row, Run

_USER = 64_017
"""An unused user, so that only our processes count for it."""

_RIGHTS = "-all,+dac_read_search"
"""To read this project wherever it is."""

_CLIENTS = 8
"""As many calls at a time: handlers of the relay wait at the same time, each on a thread of its own."""

_SPARE_FILES = (0, 0, 1, 2, 3, 4, 6, 8, 12)
"""So many descriptors are left to a process that is short of them. A connection needs several: with a few, half of it
can be made."""

_ENDED_BY_NEWCOMERS = {("files", "zeromq")}
"""libzmq 4.3.5 ends a process that has no descriptor left for an `ipc` client: docs/explanation/reliability.md."""


def _scarce(what: str, run: Run) -> Result:
    """Run it by a user who has limits."""
    if os.getuid() != 0:
        return _limited(what, run)
    user = ("setpriv", "--reuid", str(_USER), "--regid", str(_USER), "--clear-groups")
    rights = ("--inh-caps", _RIGHTS, "--ambient-caps", _RIGHTS)
    order = pickle.dumps((what, run.transport, run.seed, run.full))
    environment = {name: value for name, value in os.environ.items() if name != "ROBOCOMP_RUNTIME_DIR"}
    done = subprocess.run(
        [*user, *rights, sys.executable, "-m", "tests.faults.scarcity"],
        cwd=ROOT,
        input=order,
        stdout=subprocess.PIPE,
        env=environment | {"HOME": "/tmp", "PYTHONDONTWRITEBYTECODE": "1"},
        check=True,
    )
    result = pickle.loads(done.stdout)
    assert isinstance(result, Result)
    return result


def _limited(what: str, run: Run) -> Result:
    rounds, seconds = run.rounds(5, 1), 3.0 if run.full else 1.5
    while_short, after = Counter[str](), Counter[str]()
    deaf, chance = 0, random.Random(run.seed)
    with run.laboratory() as laboratory:
        server, relay, clients = (laboratory.start(name) for name in ("s", "r", "c"))
        server.live(kind="server", name="server")
        relay.live(kind="relay", name="relay", source="server")
        for number in range(_CLIENTS):
            clients.live(kind="client", name=f"c{number}", source="relay")
        asking, may_come = [clients], (what, run.transport) not in _ENDED_BY_NEWCOMERS
        if not may_come:
            clients.begin()
            until(lambda: _all_answered(asking), 30.0, "all clients are connected")
        for number in range(rounds):
            before = _total(asking)
            with _short(what, [server, relay, clients], chance):
                clients.begin()  # in the first round, no thread has been needed before
                if may_come:
                    asking.append(_newcomer(laboratory.start(f"n{number}"), f"n{number}"))
                time.sleep(seconds)
                while_short += _total(asking) - before
            heard = relay.heard(name="relay")
            until(lambda: _all_answered(asking), 120.0, "all clients are answered after the shortage")
            before = _total(asking)
            time.sleep(1.0)
            after += _total(asking) - before
            deaf += relay.heard(name="relay") == heard
            run.tell(f"{number + 1} of {rounds}")
            for newcomer in asking[1:]:  # or the server would have more to do in each round
                newcomer.end()
            del asking[1:]
        clients.cease()
        history = laboratory.end()
    violations = run.check(history)
    if not after["ok"]:
        violations.append(Violation("after", "no call was answered after the shortage"))
    figures = [
        Figure("rounds", rounds),
        *(Figure(f"{outcome} while short", count) for outcome, count in sorted(while_short.items())),
        Figure("ok afterwards", after["ok"]),
        Figure("not ok afterwards", after.total() - after["ok"], "", 0),
        Figure("rounds after which nothing was heard", deaf, "", 0),
    ]
    return Result(figures, violations)


def _newcomer(actor: Remote, name: str) -> Remote:
    """A client that comes while there is a shortage on the other side."""
    actor.live(kind="client", name=name, source="relay", patient=False)
    actor.begin()
    return actor


@contextlib.contextmanager
def _short(what: str, actors: list[Remote], chance: random.Random) -> Iterator[None]:
    """No new thread, or no more new files than a few, for these processes."""
    limits = {actor: resource.prlimit(actor.pid, resource.RLIMIT_NPROC) for actor in actors}
    for actor, (_, most) in limits.items():
        if what == "threads":
            resource.prlimit(actor.pid, resource.RLIMIT_NPROC, (1, most))  # each has more than that already
        else:
            actor.hoard(spare=chance.choice(_SPARE_FILES))
    yield
    for actor, before in limits.items():
        if what == "threads":
            resource.prlimit(actor.pid, resource.RLIMIT_NPROC, before)
        else:
            actor.release()


def _total(asking: list[Remote]) -> Counter[str]:
    total = Counter[str]()
    for actor in asking:
        for outcomes in actor.outcomes().values():
            total.update(outcomes)
    return total


def _all_answered(asking: list[Remote]) -> bool:
    """Whether each client gets answers: two more than it has now, one after the other."""
    before = [actor.outcomes() for actor in asking]
    time.sleep(1.0)
    now = [actor.outcomes() for actor in asking]
    return all(
        later[name].get("ok", 0) >= outcomes.get("ok", 0) + 2
        and sum(later[name].values()) - later[name].get("ok", 0) == sum(outcomes.values()) - outcomes.get("ok", 0)
        for earlier, later in zip(before, now, strict=True)
        for name, outcomes in earlier.items()
    )


_MUST = "typed outcomes while it lasts; all calls and topics work afterwards"

ROWS = [
    Row(
        "threads",
        "no thread available (RLIMIT_NPROC) while calls run, repeatedly",
        _MUST,
        HERE,
        35,
        partial(_scarce, "threads"),
        root=True,
    ),
    Row(
        "descriptors",
        "no descriptor available (RLIMIT_NOFILE) while calls run, repeatedly",
        _MUST,
        HERE,
        35,
        partial(_scarce, "files"),
        root=True,
    ),
]


def main() -> None:
    what, transport, seed, full = pickle.load(sys.stdin.buffer)
    run = Run(transport, seed, full, tell=lambda text: print(f"  {what} over {transport}: {text}", file=sys.stderr))
    sys.stdout.buffer.write(pickle.dumps(_limited(what, run)))


if __name__ == "__main__":
    main()
