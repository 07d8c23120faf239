"""`rc rerun`: runs the code of a component again, against its diary."""

from __future__ import annotations

import argparse
import contextlib
import json
import logging
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from .common import FINE, WRONG, counted
from .completing import What, completed
from .live import add_json, reported

if TYPE_CHECKING:
    from ..tools.diary.rerun import Result

NAME = "rerun"

_EXAMPLES = """\
examples:
  rcdeploy up net.ddsl --diary wander               write wander.mcap: all that enters the code of wander
  rc rerun components/wander wander.mcap            run it again: does it still do the same?
  rc rerun components/wander wander.mcap --show     ... with what it prints and logs
  rc rerun wander wander.mcap --bisect v1..main     the first commit that does something else

The code gets the same calls in the same order, with the same arguments, replies, times and random numbers. What it
sends and returns is compared octet by octet. Nothing else runs, and nothing is sent.

exit status: 0 no difference, 1 something differs or the diary is broken, 2 usage, 130/143 by a signal
"""

_SHOWN = 10
"""Differences that are printed."""

_HASH_SEED = "PYTHONHASHSEED"


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description = "Run the code of a component again, against its diary, and compare what goes out."
    to.epilog = _EXAMPLES
    folder = to.add_argument("component", type=Path, metavar="COMPONENT", help="the folder of the component")
    completed(folder, What.FOLDER)
    about = "a file that `rcdeploy --diary` has written"
    completed(to.add_argument("diary", type=Path, metavar="DIARY", help=about), ".mcap")
    to.add_argument("--bisect", metavar="GOOD..BAD", help="find the first commit of Git that differs")
    to.add_argument("--all", action="store_true", help=f"print all differences, not only the first {_SHOWN}")
    to.add_argument("--show", action="store_true", help="show what the component prints and logs, on standard error")
    add_json(to)


def run(options: argparse.Namespace) -> int:
    with reported("rc rerun") as code:
        if options.bisect is not None:
            return _bisect(options)
        return _rerun(options)
    return code()


def _rerun(options: argparse.Namespace) -> int:
    from ..runtime.load import load_worker
    from ..tools.diary.events import DiaryReader
    from ..tools.diary.rerun import rerun

    with DiaryReader(options.diary) as diary:
        seed = str(diary.start.get("hash_seed") or "")
        if seed and seed != os.environ.get(_HASH_SEED):
            return _with_hash_seed(seed, options)
        with _quiet(show=options.show):
            worker = load_worker(options.component)
            begun = time.monotonic()
            result = rerun(worker, diary)
            took = time.monotonic() - begun
        if not seed:
            result.left_out.append(f"the order of sets of texts, because {_HASH_SEED} was not set")
    if options.json:
        print(json.dumps({"diary": str(options.diary), "took": took, **asdict(result)}))
    else:
        _print(result, took, options)
    return WRONG if result.differences else FINE


def _with_hash_seed(seed: str, options: argparse.Namespace) -> int:
    """In another process, in which hashes of texts, and so the order of sets, are those of the diary."""
    words = [str(options.component), str(options.diary)]
    words += [f"--{name}" for name in ("all", "show", "json") if getattr(options, name)]
    command = [sys.executable, "-m", "robocomp_py.cli.rc", NAME, *words]
    sys.stdout.flush()
    done = subprocess.run(command, env={**os.environ, _HASH_SEED: seed}, stdout=subprocess.PIPE, text=True)
    print(done.stdout, end="")
    return done.returncode


@contextlib.contextmanager
def _quiet(*, show: bool) -> Iterator[None]:
    """What the component prints does not mix with what this command prints."""
    with contextlib.ExitStack() as end:
        if show:
            logging.basicConfig(level=logging.INFO, stream=sys.stderr, format="%(levelname)s %(name)s: %(message)s")
            end.enter_context(contextlib.redirect_stdout(sys.stderr))
        else:
            before = logging.root.manager.disable
            logging.disable(logging.CRITICAL)
            end.callback(logging.disable, before)
            away = end.enter_context(open(os.devnull, "w"))
            end.enter_context(contextlib.redirect_stdout(away))
        yield


def _print(result: Result, took: float, options: argparse.Namespace) -> None:
    from ..printable import one_line

    differences = result.differences if options.all else result.differences[:_SHOWN]
    for each in differences:
        print(one_line(str(each)))
    if more := len(result.differences) - len(differences):
        print(f"… {more} more; --all prints them")
    if result.is_parted:
        print("from there on, the component does something else; the rest cannot be compared")
    for what in dict.fromkeys(result.left_out):
        print(f"not run again: {one_line(what)}")
    fast = f", {result.seconds / took:.0f} times as fast" if took and result.seconds > took else ""
    print(
        f"{options.diary}: {counted(result.turns, 'call')}, {result.seconds:.1f} s, run again in {took:.2g} s{fast}: "
        f"{len(result.differences)} of {result.outputs} outputs differ"
    )


def _bisect(options: argparse.Namespace) -> int:
    from ..errors import ConfigurationError, RobocompError
    from ..printable import one_line
    from ..tools.diary.bisect import first_that_differs
    from ..tools.diary.events import DiaryReader

    good, dots, bad = options.bisect.partition("..")
    if not (good and dots and bad) or bad.startswith("."):
        raise ConfigurationError(f"--bisect {options.bisect}: write GOOD..BAD, two names of commits")
    with DiaryReader(options.diary):
        pass  # a broken diary is told before anything is checked out
    begun = False

    def differs(folder: Path) -> str:
        nonlocal begun
        command = [sys.executable, "-m", "robocomp_py.cli.rc", NAME, str(folder), str(options.diary), "--json"]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode not in (FINE, WRONG) or not done.stdout.strip():
            raise RobocompError(f"it cannot be run again as it was in this commit: {done.stderr.strip()}")
        found = json.loads(done.stdout)["differences"]
        begun = True
        print("x" if found else ".", end="", file=sys.stderr, flush=True)
        return f"at {found[0]['seconds']:.2f} s, event {found[0]['event']}: {found[0]['what']}" if found else ""

    try:
        found = first_that_differs(options.component, good, bad, differs)
    finally:
        if begun:
            print(file=sys.stderr)
    if options.json:
        print(json.dumps(found._asdict()))
    else:
        tried = counted(found.tried, "commit")
        print(f"the first of them that differs is {found.commit[:12]}: {found.subject} ({tried} tried)")
        print(one_line(found.difference))
    return WRONG
