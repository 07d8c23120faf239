"""`rcdeploy simulate`: run a network in virtual time, in one process."""

from __future__ import annotations

import argparse
import json
import logging
import math
import os
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from contextlib import ExitStack
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from ..common import FINE, USAGE, WRONG, complain, counted, signalled
from ..completing import What, completed
from ..network import add_network, override_words
from ..progress import Progress
from .planning import planned
from .up import seconds

if TYPE_CHECKING:
    from ...deploy.plan import Plan
    from ...virtual.simulation import Failure, Simulation

NAME = "simulate"
HELP = "run a network in virtual time, in one process"

_EXAMPLES = """\
examples:
  rcdeploy simulate net.ddsl --for 60                  one minute of virtual time, as fast as possible
  rcdeploy simulate net.ddsl --until mission --for 60  ... until that instance ends; it is an error if it does not
  rcdeploy simulate net.ddsl --for 60 --seed 7         ... with other random numbers (`self.random`)
  rcdeploy simulate net.ddsl --for 60 --speed 1        ... as fast as the clock on the wall
  rcdeploy simulate net.ddsl --for 60 --trace a.jsonl  ... and write every message: compare two runs with diff
  rcdeploy simulate net.ddsl --for 60 --check          run twice, and name the first message that differs

Equal runs have equal hashes. Ctrl-C ends a run as --for does.
Exit status: 0 fine, 1 wrong input, a component failed, or runs differ, 2 usage,
130/143 stopped by a signal. A component has also failed if a handler or an action raised an exception.
"""

_SLICE = 0.25
"""Longest time between two looks at real time, in virtual seconds."""

_AHEAD = 0.02
"""Longest time that a run with a `--speed` is ahead of real time, in seconds."""

_LEAST = 1e-6
"""Shortest time between two looks, in virtual seconds."""


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description, to.epilog = (
        "Run the components of a network in this process. Time passes only when all have done what was due.",
        _EXAMPLES,
    )
    add_network(to)
    to.add_argument("--for", dest="duration", type=seconds, metavar="SECONDS", help="virtual seconds to run")
    about = "end when this instance has ended"
    completed(to.add_argument("--until", metavar="INSTANCE", help=about), What.DECLARED)
    to.add_argument("--seed", type=_seed, default=0, metavar="N", help="seed of random numbers (default: 0)")
    to.add_argument(
        "--speed",
        type=_speed,
        default=math.inf,
        metavar="FACTOR",
        help="virtual seconds in a second (default: max)",
    )
    to.add_argument("--trace", type=Path, metavar="FILE", help="write each message as a line of JSON")
    to.add_argument("--check", action="store_true", help="run twice, and name the first message that differs")
    to.add_argument("--json", action="store_true", help="the result as JSON")


def run(options: argparse.Namespace) -> int:
    if options.check:
        return _check(options)
    plan = planned(options, as_json=options.json)
    return plan if isinstance(plan, int) else _simulate(plan, options)


def _simulate(plan: Plan, options: argparse.Namespace) -> int:
    from ...deploy.simulating import parts
    from ...errors import ComponentError, DeploymentError
    from ...spelling import unknown
    from ...virtual.simulation import Simulation

    with ExitStack() as stack:
        try:
            made = parts(plan)
            names = [part.instance for part in made]
            if options.until and options.until not in names:
                print(
                    f"rcdeploy: --until {options.until}: {unknown('instance', options.until, names)}", file=sys.stderr
                )
                return USAGE
            trace = _opened(stack, options.trace)
            sim = Simulation(made, options.seed, trace.write if trace else None)
        except (ComponentError, DeploymentError) as exc:
            return complain(f"rcdeploy: {exc}")
        except OSError as exc:
            return complain(f"rcdeploy: --trace {options.trace}: {exc.strerror}")
        _configure_logging(sim, names)
        began, code = time.monotonic(), FINE
        try:
            with sim:
                code = _run(sim, options)
                took = time.monotonic() - began
        except ComponentError as exc:
            return complain(f"rcdeploy: {exc}")
    _tell(plan.name, sim, took, as_json=options.json)
    return code or (WRONG if sim.failed or sim.errors else FINE)


def _opened(stack: ExitStack, path: Path | None) -> TextIO | None:
    return stack.enter_context(path.open("w", encoding="utf-8")) if path else None


def _run(sim: Simulation, options: argparse.Namespace) -> int:
    """Run to the end; returns the exit code."""
    from ...runtime.clock import ns

    limit, until = options.duration, options.until
    has_ended = sim[until].is_over if until else bool
    step = min(_SLICE, max(_AHEAD * options.speed, _LEAST))
    began, threads = time.monotonic(), set[str]()
    try:
        with Progress("rcdeploy") as progress:
            while True:
                left = step if limit is None else min(step, limit - sim.time)
                sim.run(until=has_ended, at_most=left)
                _warn_of_threads(sim, threads)
                if sim.over or sim.failed or has_ended():
                    break
                ahead = sim.time / options.speed - (time.monotonic() - began)
                if ahead > 0:
                    time.sleep(ahead)
                if limit is not None and ns(limit - sim.time) <= 0:
                    break
                progress.show(f"{sim.time:.0f} s{f' of {limit:g} s' if limit else ''}")
    except (KeyboardInterrupt, SystemExit):  # the components finish, and the result is shown
        return 128 + (signalled() or signal.SIGINT)
    if until and not has_ended() and not sim.failed:
        return complain(f"rcdeploy: {until} has not ended in {sim.time:g} s")
    return FINE


def _warn_of_threads(sim: Simulation, told: set[str]) -> None:
    for name in sim.foreign_threads():
        if name not in told:
            told.add(name)
            print(
                f"rcdeploy: warning: a component has started the thread `{name}`, which does not follow virtual time; "
                "what it does differs from run to run",
                file=sys.stderr,
            )


def _tell(name: str, sim: Simulation, took: float, *, as_json: bool) -> None:
    factor = sim.time / took if took else math.inf
    if as_json:
        result = {"seconds": sim.time, "took": took, "messages": sim.record.messages, "hash": sim.hash}
        print(json.dumps(result | {"failed": sim.failed, "errors": list(map(_shown, sim.errors))}))
        return
    shown = f"{factor:,.0f}" if factor >= 10 else f"{factor:.2g}"
    fast = f", {shown} times as fast as real time" if sim.time else ""
    print(f"{name}: {sim.time:.10g} s in {took:.2g} s{fast}")
    print(f"{counted(sim.record.messages, 'message')}, hash {sim.hash}")
    from ...spelling import enumerated

    if sim.failed:
        print(f"ended by a failure of {enumerated(sim.failed)}; see its log above")
    if raised := [each for each in dict.fromkeys(failure.instance for failure in sim.errors) if each not in sim.failed]:
        print(f"exceptions in the code of {enumerated(raised)}; see the log above")


def _shown(failure: Failure) -> dict[str, object]:
    what = traceback.format_exception_only(failure.exception)[-1].strip()
    return {"time": failure.time, "instance": failure.instance, "method": failure.method, "exception": what}


# Logs.


class _InVirtualTime(logging.Filter):
    """Adds the virtual time to log records, and the instance that speaks."""

    def __init__(self, sim: Simulation, names: list[str]) -> None:
        super().__init__()
        self._sim, self._names = sim, names

    def filter(self, record: logging.LogRecord) -> bool:
        record.virtual = f"{self._sim.time:.3f}"
        record.speaker = self._speaker(record.name)
        return True

    def _speaker(self, logger: str) -> str:
        """The whole name of the component that logs. Components of other systems may log by the same name."""
        if logger in self._names:
            return logger
        meant = [each for each in self._names if each.endswith(f"/{logger}")]
        return meant[0] if len(meant) == 1 else self._sim.acting or logger


def _configure_logging(sim: Simulation, names: list[str]) -> None:
    form = "%(virtual)9s %(speaker)s %(levelname)s: %(message)s"
    logging.basicConfig(level=logging.INFO, format=form, stream=sys.stderr)
    for handler in logging.getLogger().handlers:
        handler.addFilter(_InVirtualTime(sim, names))


# Comparing two runs.


def _check(options: argparse.Namespace) -> int:
    """Run twice, in processes that order sets and dictionaries of strings differently, and compare all messages."""
    if options.duration is None and options.until is None:
        print("rcdeploy: --check needs --for or --until, so that both runs end", file=sys.stderr)
        return USAGE
    with tempfile.TemporaryDirectory(prefix="robocomp-simulate-") as folder:
        first, second = options.trace or Path(folder, "first.jsonl"), Path(folder, "second.jsonl")
        runs = [
            subprocess.Popen(
                _command(options, trace),
                env={**os.environ, "PYTHONHASHSEED": seed},
                stdout=subprocess.DEVNULL,
                stderr=log,
            )
            for trace, seed, log in zip((first, second), ("1", "2"), (None, subprocess.DEVNULL), strict=True)
        ]
        codes = [each.wait() for each in runs]
        code = max(codes, key=abs)
        if code not in (FINE, WRONG) or not (first.exists() and second.exists()):
            return code
        return _compare(first, second) or code  # runs that fail alike are compared, too


def _command(options: argparse.Namespace, trace: Path) -> list[str]:
    words = [sys.executable, "-m", "robocomp_py.cli.rcdeploy", NAME, str(options.network), *override_words(options)]
    words += ["--seed", str(options.seed), "--speed", str(options.speed), "--trace", str(trace)]
    words += ["--for", str(options.duration)] if options.duration is not None else []
    return [*words, *(("--until", options.until) if options.until else ())]


def _compare(first: Path, second: Path) -> int:
    number = 0
    with first.open(encoding="utf-8") as one, second.open(encoding="utf-8") as other:
        for number, (line, differing) in enumerate(zip_longest(one, other, fillvalue=""), 1):
            if line != differing:
                print(f"the runs differ from message {number} on:\n  {line.strip() or 'nothing'}")
                print(f"  {differing.strip() or 'nothing'}")
                print(f"{_sender(line or differing)} depends on something that is not part of the simulation: the time "
                      "of day, random numbers of its own, a thread, or the order of a set")  # fmt: skip
                return WRONG
    print(f"both runs said the same: {counted(number, 'message')}")
    return FINE


def _sender(line: str) -> str:
    said = json.loads(line)
    return str(said.get("from") or said["to"].rsplit("/", 2)[0])


def _seed(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"`{text}` is not a seed; give it a number such as 0 or 42")
    return int(text)


def _speed(text: str) -> float:
    if text == "max":
        return math.inf
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not value > 0:
        raise argparse.ArgumentTypeError(
            f"`{text}` is not a speed; write 1 for real time, 10 for ten times that, or max"
        )
    return value
