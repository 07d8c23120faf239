"""Another host, as a tool sees it: a scout in this process, behind the control socket of a network."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator
from dataclasses import dataclass, field

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
    _scouts: list[Scout] = field(default_factory=list)

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

    def close(self) -> None:
        for each in self._scouts:
            each.close()
        self.running.close()


@contextlib.contextmanager
def network(*hosts: str, **instances: str) -> Iterator[Network]:
    """A network with these hosts, and the hosts of its instances. Each host has what runs in this process."""
    standing = Standing(*(process(name, host=host) for name, host in instances.items()))
    made = Network(Running(standing))
    standing.scouts = dict.fromkeys(hosts, made.scout)
    plan = {
        "name": "home",
        "hosts": [{"name": host, "address": host} for host in hosts],
        "processes": [
            {"name": name, "host": host, "instances": [name], "members": [], "component": name, "system": []}
            for name, host in instances.items()
        ],
        "ways": [],
        "ours": {name: {"channels": name, "over": ["shm"]} for name in instances},
    }
    made.running.place.leave_plan(json.dumps(plan))
    with contextlib.closing(made):
        yield made
