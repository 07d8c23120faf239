"""The launcher's side of the fork server, which starts components quickly. Its program is `forkserver.py`."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterable, Mapping
from typing import Any

from ...errors import DeploymentError
from ..agents import Abandoned
from ..asjson import to_json
from ..process import Process
from .birth import PADDING, Birth

_COMMAND = (sys.executable, "-m", "robocomp_py.cli.rc")

_EARLY = ("PYTHON", "LD_", "OMP_", "OPENBLAS_", "MKL_", "BLIS_", "NUMEXPR_", "MALLOC_", "GLIBC_", "NPY_")
"""Prefixes of variables that are read before our code runs, or while its modules are imported."""

_ANSWER = 30.0
"""Seconds within which the fork server answers, its own start included."""


class Unavailable(DeploymentError):
    """The fork server does not run, does not answer, or cannot start the process."""


def forkable(process: Process) -> bool:
    """Whether a process is one of our components, under this interpreter and with an environment that is read late."""
    return process.command[: len(_COMMAND) + 1] == (*_COMMAND, "run") and not any(
        name.startswith(_EARLY) for name in process.env
    )


class ForkServer:
    """The process that imports the modules once and forks. Its end does not affect the processes that it started."""

    def __init__(self, middlewares: Iterable[str], lifeline: int, environment: Mapping[str, str]) -> None:
        """Start the fork server. Raises OSError."""
        self._channel, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._channel.setblocking(False)
        with theirs:
            numbers = (str(theirs.fileno()), str(lifeline))
            self._running = subprocess.Popen(
                (sys.executable, "-P", "-m", "robocomp_py.deploy.launcher.forkserver", *numbers, *middlewares, PADDING),
                stdin=subprocess.DEVNULL,
                env=environment,
                pass_fds=(theirs.fileno(), lifeline),
                start_new_session=True,
            )
        self._asked: dict[int, tuple[str, asyncio.Future[int]]] = {}
        """The name and the id of the process, by the number of the request."""
        self._number = 0
        self.ended = False
        asyncio.get_running_loop().add_reader(self._channel, self._answered)

    @property
    def pid(self) -> int:
        return self._running.pid

    async def start(self, process: Process, environment: Mapping[str, str], output: int, birth: Birth) -> int:
        """Start a process, which becomes our child, and return its id. Raises Unavailable, or Abandoned."""
        if self.ended:
            raise Unavailable("the fork server has ended")
        self._number += 1
        number = self._number
        request = {
            "id": number,
            "name": process.name,
            "arguments": process.command[len(_COMMAND) :],
            "cwd": str(process.cwd),
            "env": dict(environment),
            "birth": to_json(birth),
        }
        answer: asyncio.Future[int] = asyncio.get_running_loop().create_future()
        self._asked[number] = process.name, answer
        try:
            await self._send(json.dumps(request).encode(), output)
            if not (await asyncio.wait((answer,), timeout=_ANSWER))[0]:  # `wait_for` may swallow a cancellation
                raise TimeoutError
            return answer.result()
        except asyncio.CancelledError:
            if answer.done() and not answer.exception():
                os.kill(answer.result(), signal.SIGKILL)  # it has started, but the caller will not learn its id
            raise
        except TimeoutError as exc:
            self.close()  # after a late answer, a process would run that has no owner
            raise Unavailable(f"the fork server has not answered for {_ANSWER:g} s") from exc
        except OSError as exc:
            raise Unavailable(f"the fork server: {exc.strerror}") from exc
        finally:
            self._asked.pop(number, None)

    def abandon(self, name: str) -> None:
        """Give up a requested process: if it starts nevertheless, it is ended."""
        for asked, answer in self._asked.values():
            if asked == name and not answer.done():
                answer.set_exception(Abandoned(f"{name} was stopped before it started"))

    def close(self) -> None:
        """End the fork server and wait for its end. May be called twice."""
        if not self.ended:
            self.ended = True
            asyncio.get_running_loop().remove_reader(self._channel)
            with contextlib.suppress(OSError):
                self._channel.shutdown(socket.SHUT_RDWR)  # a fork server that cannot answer ends what it starts
            while message := self._read():  # answers about processes that already run: do not start them again
                self._settle(message)
            self._channel.close()
            self._running.kill()
        if self._running.returncode is None:
            self._running.wait()
        for _, answer in self._asked.values():
            if not answer.done():
                answer.set_exception(Unavailable("the fork server has ended"))

    async def _send(self, request: bytes, output: int) -> None:
        end = asyncio.get_running_loop().time() + _ANSWER
        while True:
            try:
                socket.send_fds(self._channel, [request], [output])
                return
            except BlockingIOError:  # its queue is full
                if asyncio.get_running_loop().time() > end:
                    raise TimeoutError from None
                await asyncio.sleep(0.005)

    def _answered(self) -> None:
        message = self._read()
        if message:
            self._settle(message)
        elif message is not None:
            self.close()

    def _read(self) -> bytes | None:
        """The next answer; None if there is none yet, empty if no more will come."""
        while True:
            try:
                return self._channel.recv(65536)
            except BlockingIOError:
                return None
            except ConnectionResetError:  # reported once, ahead of the answers that wait
                continue
            except OSError:
                return b""

    def _settle(self, message: bytes) -> None:
        told: dict[str, Any] = json.loads(message)
        _, answer = self._asked.get(told["id"], ("", None))
        if answer is None or answer.done():
            with contextlib.suppress(OSError, KeyError):
                os.kill(told["pid"], 9)
        elif "pid" in told:
            answer.set_result(told["pid"])
        else:
            answer.set_exception(Unavailable(f"the fork server cannot start it: {told['error']}"))
