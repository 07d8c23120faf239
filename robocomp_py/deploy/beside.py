"""Long work beside the event loop, also when the system can start no further thread."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
from typing import TypeVar

from ..threads import fulfil, start_thread

T = TypeVar("T")


async def beside(
    function: Callable[..., T], *arguments: object, start: Callable[[threading.Thread], bool] = start_thread
) -> T:
    """Call a function on a thread of its own.

    If none can be started, the loop waits for it: `asyncio.to_thread` would raise an error, and call it later or never.
    A function that hangs does not keep the process from ending.
    """
    answer: Future[T] = Future()
    answer.set_running_or_notify_cancel()  # the caller may be cancelled; the function still runs
    job = partial(fulfil, answer, partial(function, *arguments))
    if not start(threading.Thread(target=job, name="beside", daemon=True)):
        job()
    return await asyncio.wrap_future(answer)
