"""Named instances on a clock: in lock-step over every middleware as in virtual time."""

from __future__ import annotations

import pytest

from robocomp_py.contract.component import Component, Port
from robocomp_py.contract.interface import Verb
from robocomp_py.contract.qos import PRESETS
from robocomp_py.errors import Unreachable
from robocomp_py.runtime.clock import SECOND
from robocomp_py.runtime.instances import NamedHandlers, NamedProxies
from robocomp_py.runtime.ports import has_subscribers
from robocomp_py.runtime.worker import Worker
from robocomp_py.testing.instances import NEWS, TELLER, NewsPublisher, TellerHandler, TellerProxy
from robocomp_py.testing.patience import wait_until
from robocomp_py.transports.base import find_transport
from robocomp_py.virtual.simulation import Simulation

from ..runtime.components import MIDDLEWARES
from ..runtime.running import make, running
from ..virtual.parts import part

RELIABLE = PRESETS["services_default"]


class Echo(TellerHandler):
    reads_caller = True

    def __init__(self, callers: set[str]) -> None:
        self.callers = callers

    def tell(self, what: str) -> str:
        self.callers.add(self.caller)
        return f"{self.instance} {what}"

    def note(self, number: int) -> None:
        pass


class Ring(Worker[None]):
    """Has two named instances, of which it takes one away for a while."""

    component = Component(
        "ring",
        (
            Port(Verb.IMPLEMENTS, TELLER, each=True),
            Port(Verb.PUBLISHES, NEWS, each=True, proxy=NewsPublisher, qos=RELIABLE),
        ),
        period=0.1,
    )
    middleware = "zeromq"
    teller: NamedHandlers[TellerHandler]
    news: NamedProxies[NewsPublisher]

    def __init__(self) -> None:
        self.turn = 0
        self.callers: set[str] = set()
        self.has_had_subscribers = False

    def initialize(self) -> None:
        for name in ("front", "back"):
            self.teller.add(name, Echo(self.callers))
            self.news.add(name)

    def compute(self) -> None:
        for number, proxy in enumerate(self.news.values()):
            self.has_had_subscribers |= has_subscribers(proxy)
            proxy.push(10 * self.turn + number)
        self.turn += 1
        if self.turn == 3:
            self.teller.remove("back")
            self.news.remove("back")
        if self.turn == 6:
            self.teller.add("back", Echo(self.callers))
            self.news.add("back")


class Guest(Worker[None]):
    """Asks both, and hears all."""

    component = Component(
        "guest",
        (
            Port(Verb.REQUIRES, TELLER, proxy=TellerProxy),
            Port(Verb.REQUIRES, TELLER, "1", proxy=TellerProxy),
            Port(Verb.SUBSCRIBES, NEWS, qos=RELIABLE),
        ),
        period=0.1,
    )
    middleware = "zeromq"
    reads_caller = True
    teller_proxy: TellerProxy
    teller1_proxy: TellerProxy

    def __init__(self) -> None:
        self.heard: list[int] = []
        self.publishers: set[tuple[str, int]] = set()
        self.story: list[tuple[int, str, str, list[int]]] = []

    def compute(self) -> None:
        answers = [self._ask(proxy) for proxy in (self.teller_proxy, self.teller1_proxy)]
        self.story.append((self.now() * 1000 // SECOND, *answers, sorted(self.heard)))
        self.heard.clear()

    def News_push(self, number: int) -> None:
        self.heard.append(number)
        self.publishers.add((self.caller, number % 10))

    def _ask(self, proxy: TellerProxy) -> str:
        try:
            return proxy.tell("here")
        except Unreachable:
            return "-"


Story = list[tuple[int, str, str, list[int]]]
WIRED = ("ports.teller.from=front", "ports.teller1.from=back")


def in_virtual_time() -> Story:
    sets = {"ports__teller__from": "front", "ports__teller1__from": "back"}
    with Simulation([part(Ring, "ring"), part(Guest, "guest", **sets)]) as sim:
        sim.run(until=lambda: sim["guest"].computes > 9, at_most=60.0)
        story: Story = sim["guest"].worker.story[:9]
        return story


def test_in_virtual_time_named_instances_come_and_go_at_the_same_instants() -> None:
    assert in_virtual_time() == [
        (0, "front here", "back here", [0, 1]),
        (100, "front here", "back here", [10, 11]),
        (200, "front here", "-", [20, 21]),
        (300, "front here", "-", [30]),
        (400, "front here", "-", [40]),
        (500, "front here", "back here", [50]),
        (600, "front here", "back here", [60, 61]),
        (700, "front here", "back here", [70, 71]),
        (800, "front here", "back here", [80, 81]),
    ]


@pytest.mark.parametrize("middleware", MIDDLEWARES)
def test_in_lockstep_named_instances_are_heard_and_asked_at_their_instants(middleware: str) -> None:
    """A name that comes back is found a moment later, which depends on the middleware."""
    over = f"middleware={middleware}"
    leading = ("clock.leader=ring", 'clock.followers=["guest"]', "clock.speed=0")
    with (
        running(make(Ring, find_transport, over, *leading, name="ring"), ready=False) as ring,
        running(make(Guest, find_transport, over, "clock.leader=ring", *WIRED, name="guest"), ready=False) as guest,
    ):
        wait_until(lambda: any(10 * turn + 1 in heard for turn, (*_, heard) in enumerate(guest.story) if turn > 5))
    assert (ring.outcome, guest.outcome) == (True, True)
    story = list(enumerate(guest.story[:-1]))
    assert guest.story[:2] == in_virtual_time()[:2]
    assert {each for each in guest.publishers if each[0]} == {("front", 0), ("back", 1)}
    assert ring.callers - {""} == {"guest"}
    assert ring.has_had_subscribers
    for turn, (at, front, _, heard) in story:
        assert (at, front, heard[0]) == (100 * turn, "front here", 10 * turn)
        assert heard[1:] in ([], [10 * turn + 1])
    back = [answer for _, (_, _, answer, _) in story]
    assert back[:5].count("-") >= 2
    assert {answer for answer in back[5:] if answer != "-"} <= {"back here"}
