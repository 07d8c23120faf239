"""What a configuration says of ports that go over Ice, in our form and in RoboComp's."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from robocomp_py.contract.component import Component, Port
from robocomp_py.contract.interface import Verb
from robocomp_py.errors import ConfigurationError
from robocomp_py.runtime import settings
from robocomp_py.runtime.document import Document
from robocomp_py.testing.everything import EVERYTHING

LASER, SPEECH, PUB = (replace(EVERYTHING, name=f"Robot::{name}") for name in ("Laser", "Speech", "LaserPub"))
COMPONENT = Component(
    "explorer",
    (
        Port(Verb.REQUIRES, LASER, middleware="ice"),
        Port(Verb.REQUIRES, LASER, "1", middleware="ice"),
        Port(Verb.REQUIRES, SPEECH),
        Port(Verb.IMPLEMENTS, SPEECH, middleware="ice"),
        Port(Verb.SUBSCRIBES, PUB, middleware="ice"),
    ),
)
CLASSIC = """\
LaserProxy = laser:tcp -h localhost -p 10003
Laser1Proxy = laser:tcp -h rear.local -p 10003
SpeechProxy = speech:tcp -p 1
Speech.Endpoints = tcp -p 10004
CommonBehavior.Endpoints = tcp -p 10005
LaserPubTopic.Endpoints = tcp -p 0
LaserPubTopic = zed/LaserPub
TopicManager.Proxy = IceStorm/TopicManager:default -p 9999
Ice.MessageSizeMax = 20480
Ice.Warn.Connections = 0
Ice.ACM.Client = 10
"""
OF_2025 = """\
[Proxies]
Laser = "laser:tcp -h localhost -p 10003"
Laser1 = "laser:tcp -h rear.local -p 10003"
Speech = "speech:tcp -p 1"
TopicManager = "IceStorm/TopicManager:default -p 9999"
[Endpoints]
Speech = "tcp -p 10004"
CommonBehavior = "tcp -p 10005"
LaserPubTopic = "tcp -p 0"
LaserPubPrefix = "zed"
[Ice]
MessageSizeMax = "20480"
Warn.Connections = "0"
ACM.Client = "10"
"""
OPTIONS = {
    "proxies": {"Laser": "laser:tcp -h localhost -p 10003", "Laser1": "laser:tcp -h rear.local -p 10003"},
    "endpoints": {"Speech": "tcp -p 10004", "LaserPubTopic": "tcp -p 0"},
    "topics": {"LaserPub": "zed/LaserPub"},
    "storm": "IceStorm/TopicManager:default -p 9999",
    "message_size_max": 20480 * 1024,
    "properties": {"Ice.Warn.Connections": "0"},
}


def settled(
    tmp_path: Path, text: str, *assignments: str, name: str = "config", component: Component = COMPONENT
) -> Document:
    path = tmp_path / name
    path.write_text(text)
    document = settings.read_for(path, component)
    for each in assignments:
        settings.override(document, each)
    settings.settle(document, component, "zeromq")
    return document


def sources(document: Document) -> dict[str, Any]:
    ports = settings.check(COMPONENT, document).ports
    return {key[0]: each.source for key, each in ports.items() if each.source}


def wrong(tmp_path: Path, text: str, *assignments: str, name: str = "config.toml") -> list[str]:
    try:
        settings.check(COMPONENT, settled(tmp_path, text, *assignments, name=name))
    except ConfigurationError as exc:
        return [line.rpartition("/")[2] if line.startswith("/") else line for line in str(exc).splitlines()]
    return []


# RoboComp's own files.


@pytest.mark.parametrize(("text", "name"), [(CLASSIC, "config"), (OF_2025, "config.toml")])
def test_what_a_file_says_for_ice_holds_for_the_ports_that_go_over_it(tmp_path: Path, text: str, name: str) -> None:
    document = settled(tmp_path, text, name=name)
    assert document.data["transports"] == {"ice": OPTIONS}
    assert sources(document) == {"laser": "Laser", "laser1": "Laser1"}
    idle = {note.why for note in document.notes if not note.became}
    assert idle == {
        "where Ice finds an interface, and `Speech` goes over zeromq",
        "where Ice serves an interface, and `CommonBehavior` goes over zeromq",
        "a setting of Ice, which is not taken over; transports.ice.properties sets it",
    }


def test_a_component_that_uses_only_ice_gets_all_of_robocomps_settings(tmp_path: Path) -> None:
    document = settled(tmp_path, CLASSIC, "middleware=ice")
    options = document.data["transports"]["ice"]
    assert options["endpoints"]["CommonBehavior"] == "tcp -p 10005"
    assert options["proxies"]["Speech"] == "speech:tcp -p 1"
    assert sources(document)["speech"] == "Speech"


def test_nothing_of_it_has_an_effect_where_no_port_goes_over_ice(tmp_path: Path) -> None:
    ports = [replace(port, middleware=None) for port in COMPONENT.ports]
    document = settled(tmp_path, CLASSIC, component=replace(COMPONENT, ports=tuple(ports)))
    assert document.data == {}
    assert not any(note.became for note in document.notes)


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("Ice.Warn.Connections = 1", "`Ice.Warn.Connections` is 0, as the transport needs it"),
        ("Ice.Default.Host =", "a setting of Ice, which is not taken over; transports.ice.properties sets it"),
    ],
)
def test_a_setting_that_the_transport_does_not_accept_is_reported_but_no_error(
    tmp_path: Path, line: str, why: str
) -> None:
    document = settled(tmp_path, f"{line}\n")
    assert document.data == {}
    assert [note.why for note in document.notes] == [why]
    settings.check(COMPONENT, document)


def test_explicit_settings_override_robocomps_file(tmp_path: Path) -> None:
    storm = "transports.ice.storm=IceStorm/TopicManager:tcp -p 1"
    document = settled(tmp_path, CLASSIC, storm, "ports.laser.from=world")
    assert document.data["transports"]["ice"]["storm"] == "IceStorm/TopicManager:tcp -p 1"
    assert "Laser" not in document.data["transports"]["ice"]["proxies"]
    assert sources(document)["laser"] == "world"
    why = {note.key: note.why for note in document.notes}
    assert why["TopicManager.Proxy"] == f"where the topics of IceStorm are managed, which --set {storm} says"
    assert why["LaserProxy"].endswith("--set ports.laser.from=world sets the source instead")


@pytest.mark.parametrize("names", [("Laser1Proxy", "Laser2Proxy"), ("LaserProxy0", "LaserProxy1")])
def test_proxies_may_be_numbered_from_one_or_from_nought(tmp_path: Path, names: tuple[str, str]) -> None:
    document = settled(tmp_path, "".join(f"{name} = laser:tcp -p {10003 + n}\n" for n, name in enumerate(names)))
    assert document.data["transports"]["ice"]["proxies"] == {
        "Laser": "laser:tcp -p 10003",
        "Laser1": "laser:tcp -p 10004",
    }


def test_one_operation_may_go_over_ice_alone(tmp_path: Path) -> None:
    document = settled(tmp_path, "SpeechProxy = speech:tcp -p 1", "ports.speech.divide.middleware=ice")
    assert document.data["transports"] == {"ice": {"proxies": {"Speech": "speech:tcp -p 1"}}}
    assert document.data["ports"]["speech"] == {"divide": {"middleware": "ice", "from": "Speech"}}


def test_the_proxy_of_a_port_names_its_peer(tmp_path: Path) -> None:
    checked = settings.check(COMPONENT, settled(tmp_path, CLASSIC))
    said = [checked.peer_of(port) for port in COMPONENT.ports[:3]]
    assert said == ["laser:tcp -h localhost -p 10003", "laser:tcp -h rear.local -p 10003", "any instance"]


# Ours.


def test_a_proxy_belongs_to_the_port_of_its_name_or_to_the_port_that_names_it(tmp_path: Path) -> None:
    text = (
        '[ports.laser]\nfrom = "base"\n[transports.ice.proxies]\nbase = "laser:tcp -p 1"\nlaser1 = "laser:tcp -p 2"\n'
    )
    document = settled(tmp_path, text, name="config.toml")
    assert sources(document) == {"laser": "base", "laser1": "laser1"}
    assert document.place(("ports", "laser1", "from")).endswith("config.toml:5")


def test_a_malformed_proxy_is_reported_with_its_line(tmp_path: Path) -> None:
    assert wrong(tmp_path, '[transports.ice.proxies]\n\nLaser = "laser:tpc -p 1"\n') == [
        "config.toml:3: `laser:tpc -p 1`: unknown protocol `tpc`; did you mean `tcp`?"
    ]
    assert wrong(tmp_path, "\nLaserProxy = laser:tcp -p 0\n", name="config") == [
        "config:2: `laser:tcp -p 0` says no port: write `-p` and the number of the port that it is served at"
    ]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[transports.ice]\nprxies = {}", "config.toml:2: unknown key `prxies`; did you mean `proxies`?"),
        (
            '[transports.ice.proxies]\nLasre = "laser:tcp -p 1"',
            "config.toml:2: unknown key `Lasre`; did you mean `Laser`?",
        ),
        (
            '[transports.ice.proxies]\n"base/Lasr" = "laser:tcp -p 1"',
            "config.toml:2: unknown key `Lasr`; did you mean `Laser`?",
        ),
        (
            '[transports.ice.endpoints]\nLaser = "tcp -p 1"',
            "config.toml:2: unknown key `Laser`; known: Speech, CommonBehavior, LaserPubTopic",
        ),
        (
            '[transports.ice.topics]\nLaserPbu = "x"',
            "config.toml:2: unknown key `LaserPbu`; did you mean `LaserPub`?",
        ),
    ],
)
def test_a_key_without_a_port_is_reported_with_its_line(tmp_path: Path, text: str, says: str) -> None:
    assert wrong(tmp_path, text) == [says]


def test_a_peer_that_an_override_replaces_is_not_an_error(tmp_path: Path) -> None:
    text = '[ports.laser]\nfrom = "base"\n[transports.ice.proxies]\nbase = "laser:tcp -p 1"\n'
    assert wrong(tmp_path, text, "ports.laser.from=world") == []
