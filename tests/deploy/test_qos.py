"""A network whose QoS cannot be kept is refused before it starts: both ends are named, and what to do."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from robocomp_py.cli.rcgen import main as rcgen
from robocomp_py.contract.interface import Pattern
from robocomp_py.contract.qos import History, QoS, Reliability
from robocomp_py.deploy.planner import make_plan
from robocomp_py.deploy.qos import lacking
from robocomp_py.dsl.diagnostics import Diagnostic
from robocomp_py.dsl.workspace import Workspace

Check = Callable[..., list[Diagnostic]]

PUBLISHER = """
import "LaserPub.idsl";
Component laser {{ Communications {{ publishes LaserPub{}; }}; language python; }};
"""
SUBSCRIBER = """
import "LaserPub.idsl";
Component viewer {{ Communications {{ subscribesTo LaserPub{}; }}; language python; }};
"""
NETWORK = """
import "laser/laser.cdsl"; import "viewer/viewer.cdsl";
Deployment net {{ {} Component laser {{ }}; Component viewer {{ }}; }};
"""
MODEST = """
from robocomp_py.transports.base import Capability
class Modest:
    capabilities = Capability.CROSS_PROCESS | Capability.RELIABLE
"""


@pytest.fixture
def modest(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """A middleware that is reliable, and no more, installed as third parties do."""
    metadata = tmp_path / "installed" / "modest-1.dist-info"
    metadata.mkdir(parents=True)
    (metadata / "METADATA").write_text("Name: modest\nVersion: 1\n")
    (metadata / "entry_points.txt").write_text("[robocomp_py.transports]\nmodest = modest_of_test:Modest\n")
    (metadata.parent / "modest_of_test.py").write_text(MODEST)
    monkeypatch.syspath_prepend(metadata.parent)
    return "modest"


@pytest.fixture
def check(tmp_path: Path) -> Check:
    """What is said of a laser and its viewer, of these QoS."""

    def check(offered: str, asked: str, more: str = "", config: str = "") -> list[Diagnostic]:
        for name, text, qos in (("laser", PUBLISHER, offered), ("viewer", SUBSCRIBER, asked)):
            (tmp_path / name).mkdir(exist_ok=True)
            (tmp_path / name / f"{name}.cdsl").write_text(text.format(f" qos({qos})" if qos else ""))
            assert rcgen([str(tmp_path / name / f"{name}.cdsl")]) == 0
        if config:
            (tmp_path / "viewer" / "etc" / "config.toml").write_text(config)
        network = tmp_path / "net.ddsl"
        network.write_text(NETWORK.format(more))
        workspace = Workspace()
        found = make_plan(network, workspace)
        assert (found is None) == bool(workspace.report.errors)
        return workspace.report.diagnostics

    return check


@pytest.mark.parametrize(
    ("offered", "asked", "said"),
    [
        ("", "reliable", "with `reliable`, but `laser` offers `best_effort`"),
        ("reliable", "latched", "with `transient_local`, but `laser` offers `volatile`"),
        ("", "deadline 100 ms", "with `deadline 100 ms`, but `laser` offers no `deadline`"),
        ("deadline 1 s", "deadline 100 ms", "with `deadline 100 ms`, but `laser` offers `deadline 1 s`"),
        ("lease 2 s", "lease 1 s", "with `lease 1 s`, but `laser` offers `lease 2 s`"),
        (
            "lease 1 s",
            "lease 1 s, liveliness manual_by_topic",
            "with `liveliness manual_by_topic`, but `laser` offers `liveliness automatic`",
        ),
    ],
)
def test_a_subscriber_that_asks_for_more_than_offered_is_reported_with_both_ends(
    check: Check, offered: str, asked: str, said: str
) -> None:
    (fault,) = check(offered, asked)
    assert (fault.code, fault.severity) == ("qos-mismatch", "error")
    assert said in fault.message
    assert fault.hint.startswith("publish it with qos(")
    assert [text for text, _ in fault.related] == ["the publisher"]


@pytest.mark.parametrize(
    ("offered", "asked"),
    [
        ("deadline 100 ms", "deadline 100 ms"),
        ("deadline 50 ms, lease 1 s, liveliness manual_by_topic", "deadline 100 ms, lease 2 s"),
        ("lifespan 1 s", ""),
        ("", "lifespan 1 s"),
        ("reliable, keep_all", "depth 3"),
    ],
)
def test_a_request_for_as_much_or_less_is_met(check: Check, offered: str, asked: str) -> None:
    assert check(offered, asked) == []


def test_the_configuration_counts_and_its_place_is_reported(check: Check) -> None:
    (fault,) = check("", "", config="[ports.LaserPub]\nqos = { deadline = 0.1 }\n")
    assert fault.code == "qos-mismatch"
    assert "config.toml:2" in fault.message
    assert "`deadline 100 ms`" in fault.message


@pytest.mark.parametrize(
    ("qos", "word"),
    [
        ("deadline 1 s", "deadline"),
        ("lifespan 1 s", "lifespan"),
        ("lease 1 s", "lease or liveliness"),
        ("latched", "transient_local"),
    ],
)
def test_a_qos_that_the_middleware_does_not_offer_is_reported_for_each_end(
    check: Check, modest: str, qos: str, word: str
) -> None:
    faults = check(qos, qos, f"middleware {modest};")
    assert [fault.code for fault in faults] == ["unfit-middleware"] * 2
    assert f"does not offer {word}, which `laser` asks for in its `publishes LaserPub`" in faults[0].message
    assert "`viewer` asks for in its `subscribesTo LaserPub`" in faults[1].message
    assert faults[0].hint == "choose another middleware for it, or ask for less"


def test_a_qos_that_the_middleware_of_the_other_end_does_not_offer_is_reported(check: Check, modest: str) -> None:
    [found] = check("deadline 1 s", "", config=f'middleware = "{modest}"')
    assert found.code == "unfit-middleware"
    assert "`modest` (viewer: " in found.message
    assert "does not offer deadline, which `laser` asks for in its `publishes LaserPub`" in found.message


def test_what_the_middleware_offers_is_nothing_to_tell_of(check: Check, modest: str) -> None:
    assert check("reliable", "reliable", f"middleware {modest};") == []


@pytest.mark.parametrize("middleware", ["inproc", "zeromq", "dds", "zenoh", "shm"])
def test_ours_offer_everything(middleware: str) -> None:
    everything = QoS(Reliability.RELIABLE, history=History.KEEP_ALL, deadline=1.0, lifespan=1.0, lease=1.0)
    assert lacking(middleware, Pattern.PUBLISH, everything) == []


def test_calls_have_no_qos(modest: str) -> None:
    assert lacking(modest, Pattern.QUERY, QoS(deadline=1.0)) == []
