"""What a failed test leaves running is named in its report, since later tests would meet it; processes are killed."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import threading
import time
from collections.abc import Generator, Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest

_PATIENCE_S = 1.0
"""For threads that are about to end."""

_Running = tuple[set[threading.Thread], set[int]]
_before = pytest.StashKey[_Running]()
"""What ran before a test: fixtures that other tests share are not its own."""

_failed = pytest.StashKey[bool]()


@contextlib.contextmanager
def killed_on_failure(command: Sequence[str], **options: Any) -> Iterator[subprocess.Popen[Any]]:
    """As Popen, but the process is not waited for if an assertion has failed: it may never end."""
    with subprocess.Popen(command, **options) as process:
        try:
            yield process
        except BaseException:  # also Ctrl-C and the timeout of a test
            process.kill()
            raise


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, object, object]:
    item.stash[_before] = set(threading.enumerate()), _children()
    try:
        return (yield)
    except BaseException:  # pytest's own failures are no Exception; all are raised again
        item.stash[_failed] = True
        raise


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown(item: pytest.Item) -> Generator[None, object, object]:
    try:
        return (yield)
    finally:
        if item.stash.get(_failed, False) and (left := list(_ended(*item.stash[_before]))):
            item.add_report_section("teardown", "leftovers", "\n".join(left))


def _ended(threads: set[threading.Thread], processes: set[int]) -> Iterator[str]:
    """Kill the new processes and wait for the new threads; say which there were, or still are."""
    for pid in sorted(_children() - processes):
        with contextlib.suppress(OSError):  # ended meanwhile
            words = Path(f"/proc/{pid}/cmdline").read_text().replace("\0", " ")
            if "from multiprocessing." in words:
                continue  # Python's own, for the whole session; it warns if one has gone
            os.kill(pid, signal.SIGKILL)
            yield f"process {pid}, killed now: {words}"
    end = time.monotonic() + _PATIENCE_S
    for each in set(threading.enumerate()) - threads:
        each.join(max(0.0, end - time.monotonic()))
        if each.is_alive():
            yield f"thread {each.name}, which runs on and may disturb later tests of this process"


def _children() -> set[int]:
    """The processes that any thread of this one has started and that were not waited for."""
    found = set[int]()
    for children in Path("/proc/self/task").glob("*/children"):
        with contextlib.suppress(OSError):  # its thread has ended
            found.update(map(int, children.read_text().split()))
    return found
