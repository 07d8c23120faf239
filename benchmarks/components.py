"""Runs components as processes, as `rcdeploy` does, in a separate run-time folder."""

from __future__ import annotations

import contextlib
import os
import socket
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from .ours import options
from .pair import place
from .parties import PATIENCE
from .process import ROOT, running

COMPONENTS = ROOT / "components"
"""Those that are shipped."""


@dataclass(frozen=True)
class Ready:
    pid: int
    seconds: float
    """From the start of its process until it said that it is ready."""


@contextlib.contextmanager
def component(
    name: str,
    folder: Path,
    middleware: str,
    *settings: str,
    instance: str = "",
    runtime: str = "",
    domain: str = "own",
    **environment: str,
) -> Iterator[Ready]:
    """The component of that name in a folder. It meets others with the same run-time folder.

    In the domain `default`, its transport has no options, so that tools find it.
    """
    with contextlib.ExitStack() as undo:
        here = undo.enter_context(place())
        command = [sys.executable, "-m", name, "--middleware", middleware, "--set", "component.log=warning"]
        command += ["--name", instance or name]
        chosen = {} if domain == "default" else options(middleware, here)
        transport = (f"transports.{middleware}.{key}={value}" for key, value in chosen.items())
        for each in (*settings, *transport):
            command += ["--set", each]
        told = undo.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM))
        told.bind(f"{here.folder}/notify")
        told.settimeout(3 * PATIENCE)
        ours = {"NOTIFY_SOCKET": f"{here.folder}/notify", "ROBOCOMP_RUNTIME_DIR": runtime or here.folder}
        begun = time.perf_counter()
        process = undo.enter_context(running(command, cwd=folder, env=os.environ | ours | environment))
        while b"READY=1" not in told.recv(4096):
            pass
        yield Ready(process.pid, time.perf_counter() - begun)
