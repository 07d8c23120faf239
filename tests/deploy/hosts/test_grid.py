"""Every way of a network over hosts carries what it should, counted at both ends.

The grid: each middleware that reaches other hosts; one provider, two on one host, two on two hosts, one in the process
of the client; with keys and without; publications, commands and queries. One network has all cells of a middleware and
a security. Needs root.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterator

import pytest

from tests.deploy.hosts.site import LONG, Site, generate, gone, laid_out

pytestmark = pytest.mark.tool

COUNT = 40

IDSL = """
module RoboCompGrid
{
    interface Talk
    {
        [query] idempotent int ask(int number);
        [command] void tell(int number);
        [query] int publish(int count);
        [query] idempotent int asked();
        [query] idempotent int told();
    };
    interface News { [publish] void item(int publisher, int number); };
};
"""
SOURCE = """
import "../Grid.idsl";
Component Source
{
    Communications { implements Talk; publishes News qos(reliable, depth 100); };
    language python; period 20 ms;
};
"""
CLIENT = """
import "../Grid.idsl";
Component Client%(number)d
{
    Communications { requires %(talks)s; subscribesTo News qos(reliable, depth 100); };
    language python; period 20 ms;
};
"""
SOURCING = """
    tells = asks = 0
    begun = False

    def initialize(self) -> None:
        self.id = random.getrandbits(31)

    def compute(self) -> None:
        if not self.begun:
            self.news_proxy.item(self.id, 0)

    def Talk_ask(self, number: int) -> int:
        self.asks += 1
        return number + 1

    def Talk_tell(self, number: int) -> None:
        self.tells += 1

    def Talk_publish(self, count: int) -> int:
        self.begun = True
        for number in range(count):
            self.news_proxy.item(self.id, number + 1)
        return self.id

    def Talk_asked(self) -> int:
        return self.asks

    def Talk_told(self) -> int:
        return self.tells
"""
CLIENTING = f"""
    stage = 0

    def initialize(self) -> None:
        self.heard = Counter()
        self.greeted = set()
        self.publishers = []

    def compute(self) -> None:
        talks = [getattr(self, name) for name in ("talk_proxy", "talk1_proxy") if hasattr(self, name)]
        if self.stage == 0:
            answers = [talk.ask(number) for talk in talks for number in range({COUNT})]
            self.log.info("query: %s answered, %s asked", len(answers), [talk.asked() for talk in talks])
            for talk in talks:
                for number in range({COUNT}):
                    talk.tell(number)
            self.stage = 1
        elif self.stage == 1 and all(talk.told() >= {COUNT} for talk in talks):
            self.log.info("command: %s each sent, %s executed", {COUNT}, [talk.told() for talk in talks])
            self.stage = 2
        elif self.stage == 2 and len(self.greeted) == len(talks):
            self.publishers = [talk.publish({COUNT}) for talk in talks]
            self.stage = 3
        elif self.stage == 3 and all(self.heard[each] >= {COUNT} for each in self.publishers):
            self.log.info("publish: %s each sent, %s heard", {COUNT}, [self.heard[each] for each in self.publishers])
            self.stop()

    def News_item(self, publisher: int, number: int) -> None:
        if number:
            self.heard[publisher] += 1
        else:
            self.greeted.add(publisher)
"""

INSTANCES = """
System one
{
    Component a : Source { host robot; };
    Component client : Client1 { host tower; requires Talk from a; };
};
System two
{
    Component a : Source { host robot; };
    Component b : Source { host robot; };
    Component client : Client2 { host tower; requires Talk from a; requires Talk1 from b; };
};
System apart
{
    Component a : Source { host robot; };
    Component b : Source { host base; };
    Component client : Client2 { host tower; requires Talk from a; requires Talk1 from b; };
};
System shared
{
    Component a : Source { host tower; process p; };
    Component b : Source { host robot; };
    Component client : Client2 { host tower; process p; requires Talk from a; requires Talk1 from b; };
};
"""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    components = tmp_path_factory.mktemp("components")
    (components / "Grid.idsl").write_text(IDSL)
    generate(components, "source", SOURCE, SOURCING, "import random")
    for number, talks in ((1, "Talk"), (2, "Talk, Talk")):
        model = CLIENT % {"number": number, "talks": talks}
        generate(components, f"client{number}", model, CLIENTING, "from collections import Counter")
    with laid_out(components) as made:
        for name in ("robot", "base", "tower"):
            made.host(name)
        yield made


@pytest.mark.parametrize(
    ("middleware", "security"),
    [("zeromq", "open"), ("zenoh", "open"), ("dds", "open"), ("ice", "open"), ("zeromq", "lan"), ("zenoh", "lan")],
)
def test_nothing_is_lost_between_hosts_in_either_direction(site: Site, middleware: str, security: str):
    net = site.network(INSTANCES, f"security {security};")
    if security == "lan":
        refused = site.done(net, "--middleware", middleware)
        assert refused.code == 1, refused.text
        command = shlex.split(refused.text.rpartition("run: rcdeploy ")[2].splitlines()[0])
        made = site.done(*command)
        assert made.code == 0, made.text
    run = site.run(net, "--middleware", middleware, *(["--insecure"] if security == "open" else []))
    try:
        for process, providers in (("one/client", 1), ("two/client", 2), ("apart/client", 2), ("shared/p", 2)):
            each = ", ".join([str(COUNT)] * providers)
            run.says(rf"{process} │ .*query: {providers * COUNT} answered, \[{each}\] asked")
            run.says(rf"{process} │ .*command: {COUNT} each sent, \[{each}\] executed")
            run.says(rf"{process} │ .*publish: {COUNT} each sent, \[{each}\] heard")
    finally:
        run.interrupt()
    assert run.wait(LONG) in (0, 130), run.text
    gone(site, "robot", "base", "tower")
