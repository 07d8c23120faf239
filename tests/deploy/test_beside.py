"""Work beside the event loop is done once, whether or not there is a thread for it."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable

import pytest

from robocomp_py.deploy.beside import beside
from robocomp_py.testing.patience import SOON
from robocomp_py.threads import start_thread


def no_thread(thread: threading.Thread) -> bool:
    return False


@pytest.mark.parametrize(("start", "here"), [(start_thread, False), (no_thread, True)])
def test_work_is_done_once_with_a_thread_and_without(start: Callable[[threading.Thread], bool], here: bool) -> None:
    done: list[threading.Thread] = []
    asyncio.run(beside(lambda: done.append(threading.current_thread()), start=start))
    assert [each is threading.current_thread() for each in done] == [here]


@pytest.mark.parametrize("start", [start_thread, no_thread])
def test_what_work_raises_reaches_its_caller(start: Callable[[threading.Thread], bool]) -> None:
    with pytest.raises(ValueError, match="nonsense"):
        asyncio.run(beside(int, "nonsense", start=start))


def test_work_goes_on_when_its_caller_is_cancelled() -> None:
    begun, may_end, ended = threading.Event(), threading.Event(), threading.Event()

    def work() -> None:
        begun.set()
        may_end.wait(SOON * 6)
        ended.set()

    async def cancel() -> None:
        task = asyncio.create_task(beside(work))
        while not begun.is_set():
            await asyncio.sleep(0.01)
        task.cancel()
        await asyncio.wait([task])
        assert task.cancelled()

    asyncio.run(cancel())
    may_end.set()
    assert ended.wait(SOON * 6)
