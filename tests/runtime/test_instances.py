"""Named instances: one component provides an interface under names that come and go."""

from __future__ import annotations

import logging
import socket
import subprocess
import sys
from contextlib import AbstractContextManager, ExitStack, nullcontext
from pathlib import Path
from typing import Any

import pytest

from robocomp_py.contract.component import HANDLER, WORKER, Port
from robocomp_py.errors import ComponentError, ConfigurationError
from robocomp_py.runtime import settings
from robocomp_py.runtime.effective import as_toml, effective
from robocomp_py.runtime.instances import Entry, InstanceHandler, NamedHandlers
from robocomp_py.runtime.worker import Worker
from robocomp_py.testing.instances import House, InstancesConformance, InstancesSuite, Teller
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.transports import headroom
from tests.transports.over import OverDDS, OverInproc, OverShm, OverZenoh, OverZeroMQ


@pytest.fixture(autouse=True)
def alone(own_runtime_folder: Path) -> None:
    """No test meets the components of another one."""


class TestInproc(OverInproc, InstancesConformance):
    pass


class TestShm(OverShm, InstancesConformance):
    pass


class TestZeroMQ(OverZeroMQ, InstancesConformance):
    pass


class TestDDS(OverDDS, InstancesConformance):
    pass


class TestZenoh(OverZenoh, InstancesConformance):
    pass


class Eager:
    """Connects instances, and calls them at once."""

    def __init__(self, answers: list[str]) -> None:
        self._answers = answers

    def bind(self, port: Port, entry: Entry[Any]) -> None:
        self._answers.append(entry.given.tell("hello"))

    def unbind(self, entry: Entry[Any]) -> None:
        pass

    def suspended(self) -> AbstractContextManager[None]:
        return nullcontext()

    def changed(self) -> None:
        pass


class TestOfAComponent(OverInproc, InstancesSuite):
    """What a component is told, once for all transports."""

    def test_a_handler_knows_its_name_when_the_first_call_comes(self) -> None:
        port = House.component.ports[0]
        teller: NamedHandlers[Teller] = NamedHandlers(port, "house", None)
        answers: list[str] = []
        teller.begin(Eager(answers))
        teller.add("front", Teller())
        assert answers == ["front: hello"]

    def test_a_handler_that_could_not_be_added_has_no_name(self) -> None:
        teller: NamedHandlers[Teller] = NamedHandlers(House.component.ports[0], "house", frozenset({"front"}))
        handler = Teller()
        with pytest.raises(ConfigurationError):
            teller.add("back", handler)
        assert handler.instance == ""
        assert teller.add("front", handler).instance == "front"

    @pytest.mark.parametrize("name", ["", "a b", "1st", "a/b", "*", None])
    def test_a_bad_name_is_refused(self, house: House, name: Any) -> None:
        with pytest.raises(ValueError, match="is not a name for an instance"):
            house.teller.add(name, Teller())

    def test_a_name_is_added_once(self, house: House) -> None:
        house.teller.add("front", Teller())
        with pytest.raises(ValueError, match="`front` was added before; remove it first"):
            house.teller.add("front", Teller())

    def test_a_handler_has_one_name(self, house: House) -> None:
        teller = house.teller.add("front", Teller())
        with pytest.raises(ValueError, match="this handler was added as `front`; make one for each name"):
            house.teller.add("back", teller)
        house.teller.remove("front")
        assert teller.instance == ""
        house.teller.add("back", teller)
        assert teller.instance == "back"

    @pytest.mark.parametrize(
        ("given", "what"), [(Teller, r"not the class Teller itself: write Teller\(…\)"), ("x", "not of str")]
    )
    def test_what_cannot_answer_is_refused(self, house: House, given: Any, what: str) -> None:
        with pytest.raises(TypeError, match=f"an object of a class derived from TellerHandler, {what}"):
            house.teller.add("front", given)
        assert not house.teller

    def test_an_unknown_name_is_told_with_a_similar_one(self, house: House) -> None:
        house.teller.add("front", Teller())
        with pytest.raises(KeyError, match="front"):
            house.teller.remove("fromt")
        with pytest.raises(KeyError, match="front"):
            _ = house.teller["fromt"]

    def test_it_warns_of_a_limit_when_it_is_ready_and_when_an_instance_is_added(
        self, ending: ExitStack, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
    ) -> None:
        monkeypatch.setattr(headroom, "_SHARE", 0.0)
        monkeypatch.setattr(headroom, "_told", told := set[str]())
        house = self.start(ending)
        wait_until(lambda: "file descriptors are in use" in caplog.text)
        caplog.clear()
        told.clear()
        house.teller.add("front", Teller())
        assert "file descriptors are in use" in caplog.text

    def test_instances_are_a_mapping(self, house: House) -> None:
        front = house.news.add("front")
        assert dict(house.news) == {"front": front}
        assert "front" in house.news
        assert repr(house.news) == "<News each: front>"
        assert repr(house.teller) == "<Teller each: none>"

    def test_nothing_is_published_before_the_component_has_begun(self) -> None:
        class Early(House):
            def __init__(self) -> None:
                super().__init__()
                self.news.add("front").push(1)

        with ExitStack() as ending, pytest.raises(ComponentError, match="nothing can be published before `initialize`"):
            self.start(ending, kind=Early)

    def test_what_init_adds_is_there_when_the_component_begins(self, visit: Any) -> None:
        class Early(House):
            def __init__(self) -> None:
                super().__init__()
                self.teller.add("front", Teller())
                self.proxy = self.news.add("front")

        with ExitStack() as ending:
            house: Any = self.start(ending, kind=Early)
            assert visit("front").teller().tell("hello") == "front: hello"
            house.proxy.push(1)

    def test_a_name_that_the_network_does_not_declare_is_refused(self) -> None:
        with ExitStack() as ending:
            house = self.start(ending, sets=["offers.front.Teller={}", "offers.back.Teller={}", "offers.back.news={}"])
            house.teller.add("front", Teller())
            with pytest.raises(ConfigurationError) as told:
                house.teller.add("left", Teller())
            assert str(told.value) == (
                "the network does not declare that `house` offers `left : Teller` (declared: back, front); "
                "write in its block: offers left : Teller;"
            )
            with pytest.raises(ConfigurationError, match="declared: back"):
                house.news.add("front")

    def test_a_network_may_declare_no_name(self) -> None:
        with ExitStack() as ending:
            house = self.start(ending, sets=["offers={}"])
            with pytest.raises(ConfigurationError, match="it declares none"):
                house.teller.add("left", Teller())

    def test_a_declared_name_that_is_not_added_is_told(self, caplog: pytest.LogCaptureFixture) -> None:
        with caplog.at_level(logging.WARNING), ExitStack() as ending:
            self.start(ending, sets=["offers.front.Teller={}", "offers.back.Teller={}", "offers.back.news={}"],
                       at_once=lambda house: house.teller.add("back", Teller()))  # fmt: skip
        told = [record.getMessage() for record in caplog.records if "declares" in record.getMessage()]
        offers, lacks = "the network declares that `house` offers", "which it has not added"
        assert told == [
            f"{offers} `front : Teller`, {lacks}: call self.teller.add('front', ...), or correct the network",
            f"{offers} `back : News`, {lacks}: call self.news.add('back'), or correct the network",
        ]

    def test_the_launcher_is_told_how_named_instances_differ_from_the_declared_ones(
        self, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
    ) -> None:
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        with ExitStack() as ending:
            launcher = ending.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM))
            launcher.bind(str(tmp_path / "notify"))
            launcher.settimeout(SOON)

            def status() -> str:
                """The next one that is told."""
                while not (told := launcher.recv(4096).decode()).startswith("STATUS="):
                    pass
                return told.removeprefix("STATUS=")

            house = self.start(ending, sets=["offers.front.Teller={}"])
            missing = "does not offer front : Teller, which the network declares"
            assert status() == missing
            house.teller.add("front", Teller())
            assert status() == ""
            with pytest.raises(ConfigurationError):
                house.teller.add("left", Teller())
            refused = "wanted to offer left : Teller, which the network does not declare"
            assert status() == refused
            house.teller.remove("front")
            assert status() == f"{missing}; {refused}"

    def test_its_status_lists_named_instances(self, house: House) -> None:
        house.teller.add("front", Teller())
        house.news.add("front")
        listed = [port.name for port in self.running._status().ports]
        assert listed == ["front/Teller", "front/News"]
        house.teller.remove("front")
        assert [port.name for port in self.running._status().ports] == ["front/News"]


@pytest.mark.parametrize(
    ("said", "complaint"),
    [
        ("offers.front.Tellar={}", "unknown port `Tellar`"),
        ('offers."a b".Teller={}', "'a b' is not a name for an instance"),
        ("offers=1", "`offers` must be a table"),
        ("offers.front.Teller.nonsense=1", "unknown key `nonsense`"),
    ],
)
def test_wrong_settings_are_told(said: str, complaint: str) -> None:
    document = settings.Document()
    key, _, value = said.partition("=")
    document.data = settings.tomllib.loads(f"{key} = {value}")
    with pytest.raises(ConfigurationError, match=complaint):
        settings.check(House.component, document)


def test_an_instance_has_the_settings_of_its_port_and_its_own() -> None:
    document = settings.Document()
    for each in ("ports.Teller.middleware=dds", "offers.front.Teller.tell.middleware=shm", "offers.back.Teller={}"):
        settings.override(document, each)
    checked = settings.check(House.component, document)
    teller, news = House.component.ports
    assert checked.port(teller, "tell", "front").middleware == "shm"
    assert checked.port(teller, "note", "front").middleware == "dds"
    assert checked.port(teller, "tell", "back").middleware == "dds"
    assert checked.offered(teller) == {"front", "back"}
    assert checked.offered(news) == frozenset()
    shown = as_toml(effective(House.component, checked, document, "zeromq"))
    assert "[offers.front.Teller.tell]" in shown
    assert settings.check(House.component, settings.from_text(shown, Path("shown.toml"))).offers == checked.offers


def test_the_names_that_are_taken_are_those_of_workers_and_handlers() -> None:
    own = {name for name in (*dir(Worker), *Worker.__annotations__) if name.isidentifier() and name.islower()}
    plain = {name for name in own if not name.startswith("_") and not name.startswith("on_")}
    assert plain | {"statemachine"} == WORKER
    handler = {name for name in dir(InstanceHandler) if not name.startswith("_")}
    assert handler == HANDLER


def test_a_component_without_named_instances_does_not_import_them() -> None:
    imports = "import sys, robocomp_py.runtime.api, robocomp_py.runtime.run"
    program = f"{imports}; print('robocomp_py.runtime.instances' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"
