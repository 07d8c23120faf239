"""Another host, as a tool sees it: a scout behind the control socket of a network.

It is in this process, and sees what runs here, or it is a process of its own, and sees what has another folder.
"""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from robocomp_py.deploy.scouting import Scout as Reached
from robocomp_py.tools.scout import Scout

from ..deploy.networks import Standing, process
from ..deploy.test_control import Running


@dataclass
class Network:
    """The network `home`."""

    running: Running
    questions: list[str] = field(default_factory=list)
    """What its scouts were asked."""
    _scouts: list[Scout | _Apart] = field(default_factory=list)

    @property
    def standing(self) -> Standing:
        return self.running.network

    def cut(self) -> None:
        """Lose all hosts."""
        self.running.call(self.standing.cut)

    def scout(self) -> Reached:
        loop = self.running.loop
        scout = Scout(lambda message: loop.call_soon_threadsafe(reached.hear, json.dumps(message)))

        def say(line: str) -> None:
            self.questions.append(line)
            scout.ask(json.loads(line))

        reached = Reached(say, lambda: None)
        self._scouts.append(scout)
        return reached

    def scout_of(self, folder: Path) -> Reached:
        """A scout that is a process of its own, and looks at what has this run-time folder."""
        loop = self.running.loop
        scout = _Apart(folder, lambda line: loop.call_soon_threadsafe(reached.hear, line))
        self._scouts.append(scout)
        reached = Reached(scout.say, scout.end)
        return reached

    def close(self) -> None:
        for each in self._scouts:
            each.close()
        self.running.close()


class _Apart:
    def __init__(self, folder: Path, hear: Callable[[str], object]) -> None:
        pipe, command = subprocess.PIPE, [sys.executable, "-m", "robocomp_py.tools.scout"]
        self._process = subprocess.Popen(command, stdin=pipe, stdout=pipe, env=_environment(folder), text=True)
        self._thread = threading.Thread(target=self._read, args=(hear,))
        self._thread.start()

    def say(self, line: str) -> None:
        assert self._process.stdin
        self._process.stdin.write(line.rstrip("\n") + "\n")
        self._process.stdin.flush()

    def end(self) -> None:
        assert self._process.stdin
        self._process.stdin.close()

    def close(self) -> None:
        self.end()
        self._thread.join()
        self._process.wait()

    def _read(self, hear: Callable[[str], object]) -> None:
        assert self._process.stdout
        with self._process.stdout as lines:
            for line in lines:
                hear(line.rstrip("\n"))


def _environment(folder: Path) -> dict[str, str]:
    return os.environ | {"ROBOCOMP_RUNTIME_DIR": str(folder)}


@contextlib.contextmanager
def apart(folder: Path, module: str) -> Iterator[None]:
    """A process that runs this module with a run-time folder, once it says that it is ready."""
    folder.mkdir(mode=0o700, exist_ok=True)
    pipe, command = subprocess.PIPE, [sys.executable, "-m", module]
    process = subprocess.Popen(command, stdin=pipe, stdout=pipe, env=_environment(folder), text=True)
    with process:
        assert process.stdout
        assert process.stdout.readline() == "ready\n"
        yield
        process.communicate()


@contextlib.contextmanager
def network(
    *hosts: str, folder: Path | None = None, command: Sequence[str] = (), **instances: str
) -> Iterator[Network]:
    """A network with these hosts, and the hosts of its instances, which were started by this command.

    Each host has what runs in this process, or else what has this run-time folder.
    """
    standing = Standing(*(process(name, host=host) for name, host in instances.items()))
    made = Network(Running(standing))
    standing.scouts = dict.fromkeys(hosts, partial(made.scout_of, folder) if folder else made.scout)
    plan = {
        "name": "home",
        "hosts": [{"name": host, "address": host} for host in hosts],
        "processes": [
            {
                "name": name,
                "host": host,
                "instances": [name],
                "members": [],
                "component": name,
                "system": [],
                "command": command,
            }
            for name, host in instances.items()
        ],
        "ways": [],
        "ours": {name: {"channels": name, "over": ["shm"]} for name in instances},
    }
    made.running.place.leave_plan(json.dumps(plan))
    with contextlib.closing(made):
        yield made
