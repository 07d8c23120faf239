"""The launcher's handle on the keeper, the process that cleans up. It is told what runs, and replaced if it ends."""

from __future__ import annotations

import asyncio
import logging
import os
import subprocess
import sys
from pathlib import Path

from .leftovers import Leftovers

log = logging.getLogger("robocomp.deploy")

_REPLACED = 10
"""Maximum number of times that a keeper is replaced."""


class Keeper:
    def __init__(self, network: str, folder: Path, lifeline: int, left: Leftovers) -> None:
        """`lifeline` is the end that keeps processes alive; `left` is what runs, kept up to date by the caller.

        Raises OSError if it cannot be started.
        """
        self._arguments = (network, str(folder), str(lifeline))
        self._lifeline, self._left = lifeline, left
        self._replaced = 0
        self._begin()

    @property
    def pid(self) -> int:
        return self._running.pid

    def started(self, pid: int, at: int) -> None:
        self._tell(f"+{pid} {at}")

    def ended(self, pid: int) -> None:
        self._tell(f"-{pid}")

    def close(self) -> None:
        """Kill the keeper: all processes have ended, so there is nothing to clean up."""
        self._running.kill()
        self._end()

    def _begin(self) -> None:
        out, into = os.pipe()
        os.set_blocking(into, False)
        try:
            # Written before it begins: with it, the keeper finds all processes, even if the launcher is killed now.
            os.write(into, f"={self._left.launch} {self._left.boot} {self._left.cgroup}\n".encode())
            self._running = subprocess.Popen(
                (sys.executable, "-P", "-m", "robocomp_py.deploy.launcher.keeper", *self._arguments),
                stdin=out,
                pass_fds=(self._lifeline,),
                start_new_session=True,
            )
        except OSError:
            os.close(into)
            raise
        finally:
            os.close(out)
        self._pipe = into
        self._handle = os.pidfd_open(self._running.pid)
        asyncio.get_running_loop().add_reader(self._handle, self._gone)
        for pid, at in self._left.processes.items():
            self.started(pid, at)

    def _end(self) -> None:
        """Wait for it, once it was killed."""
        if self._pipe < 0:
            return
        asyncio.get_running_loop().remove_reader(self._handle)
        os.close(self._handle)
        os.close(self._pipe)
        self._pipe = -1
        self._running.wait()

    def _gone(self) -> None:
        self._running.kill()  # it may be stopped rather than gone
        self._end()
        self._replaced += 1
        if self._replaced > _REPLACED:
            log.warning("the cleanup process is killed repeatedly; continuing without it")
            return
        try:
            self._begin()
        except OSError as exc:
            log.warning("continuing without a cleanup process: %s", exc.strerror)

    def _tell(self, line: str) -> None:
        if self._pipe < 0:
            return
        try:
            os.write(self._pipe, f"{line}\n".encode())
        except BlockingIOError:  # it does not read
            self._gone()
        except OSError:
            pass  # it has ended, which is noticed on its own
