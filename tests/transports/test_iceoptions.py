"""What transport `ice` is told, and how addresses of Ice are read: text only, no Ice."""

from __future__ import annotations

import re
from typing import Any

import pytest

from robocomp_py.errors import ConfigurationError
from robocomp_py.transports import iceoptions
from robocomp_py.transports.iceoptions import IceEndpoint, IceOptions, IceProxy, parse_endpoints, parse_proxy


@pytest.mark.parametrize(
    ("text", "identity", "endpoints"),
    [
        ("laser:tcp -h localhost -p 10003", "laser", [IceEndpoint("tcp", "localhost", 10003)]),
        ("laser:tcp -p 10003", "laser", [IceEndpoint("tcp", "", 10003)]),
        (" omnirobot : tcp  -p  10004 ", "omnirobot", [IceEndpoint("tcp", "", 10004)]),
        ("IceStorm/TopicManager:default -p 9999", "IceStorm/TopicManager", [IceEndpoint("default", "", 9999)]),
        (
            "laser -t -e 1.1:tcp -p 1 -t 500:ssl -p 2 -z",
            "laser",
            [IceEndpoint("tcp", "", 1), IceEndpoint("ssl", "", 2)],
        ),
        ('laser:tcp -h "fd00::10" -p 3', "laser", [IceEndpoint("tcp", "fd00::10", 3)]),
    ],
)
def test_a_proxy_is_an_object_and_where_it_is(text: str, identity: str, endpoints: list[IceEndpoint]) -> None:
    assert parse_proxy(text) == IceProxy(identity, tuple(endpoints))


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "lacks the name of an object"),
        ("tcp -h localhost -p 10003", "in front of it: `NAME:tcp -h localhost -p 10003`"),
        ("laser", "says no place: write `laser:tcp -h HOST -p PORT`"),
        ("laser @ Adapter", "needs IceGrid to be found: write `laser:tcp -h HOST -p PORT`"),
        ("laser:", "has an empty endpoint"),
        ("laser:tpc -p 10003", "unknown protocol `tpc`; did you mean `tcp`?"),
        ("laser:tcp -q 3", "unknown option `-q`"),
        ("laser:tcp -h -p 3", "`-h` lacks its value"),
        ("laser:tcp -p", "`-p` lacks its value"),
        ("laser:tcp -h localhost", "says no port"),
        ("laser:tcp -h localhost -p 0", "says no port"),
        ("laser:tcp -p 70000", "`-p 70000` is not a port"),
        ("laser:tcp -p ten", "`-p ten` is not a port"),
    ],
)
def test_what_is_no_proxy_is_refused_with_the_reason(text: str, why: str) -> None:
    with pytest.raises(ValueError, match=re.escape(why)):
        parse_proxy(text)


def test_endpoints_may_omit_host_and_port_and_name_no_object() -> None:
    assert parse_endpoints("tcp") == (IceEndpoint("tcp"),)
    assert parse_endpoints("tcp -p 1:ssl -h a -p 2") == (IceEndpoint("tcp", "", 1), IceEndpoint("ssl", "a", 2))
    with pytest.raises(ValueError, match="begins with the name of an object: write `tcp -p 3`"):
        parse_endpoints("laser:tcp -p 3")


@pytest.mark.parametrize(
    ("options", "key", "code"),
    [
        ({"prxies": {}}, ("prxies",), "config-unknown-key"),
        ({"host": 7}, ("host",), "config-wrong-type"),
        ({"host": ""}, ("host",), "config-bad-address"),
        ({"host": "tcp -h 10.0.0.2"}, ("host",), "config-bad-address"),
        ({"storm": "tcp -p 9999"}, ("storm",), "config-bad-address"),
        ({"message_size_max": -1}, ("message_size_max",), "config-out-of-range"),
        ({"message_size_max": 2**31}, ("message_size_max",), "config-out-of-range"),
        ({"message_size_max": "20 MB"}, ("message_size_max",), "config-out-of-range"),
        ({"proxies": "laser:tcp -p 1"}, ("proxies",), "config-wrong-type"),
        ({"proxies": {"Laser": 10003}}, ("proxies", "Laser"), "config-wrong-type"),
        ({"proxies": {"Laser": "laser"}}, ("proxies", "Laser"), "config-bad-address"),
        ({"endpoints": {"Laser": "laser:tcp -p 1"}}, ("endpoints", "Laser"), "config-bad-address"),
        ({"topics": {"LaserPub": "zed//x"}}, ("topics", "LaserPub"), "config-bad-name"),
        ({"properties": {"Warn": "1"}}, ("properties", "Warn"), "config-unknown-key"),
        ({"properties": {"Ice": {"Warn": "1"}}}, ("properties", "Ice"), "config-wrong-type"),
        ({"properties": {"Ice.Default.Host": "x"}}, ("properties", "Ice.Default.Host"), "config-unknown-key"),
        ({"properties": {"Ice.Warn.Connections": 1}}, ("properties", "Ice.Warn.Connections"), "config-unknown-key"),
        (
            {"properties": {"Ice.Admin.Endpoints": "tcp -h 0.0.0.0"}},
            ("properties", "Ice.Admin.Endpoints"),
            "config-unknown-key",
        ),
    ],
)
def test_errors_are_reported_by_their_keys(options: dict[str, Any], key: tuple[str, ...], code: str) -> None:
    [complaint] = iceoptions.examine(options)
    assert (complaint.key, complaint.code) == (key, code)
    with pytest.raises(ConfigurationError, match=r"transports\.ice\."):
        iceoptions.read(options)


def test_a_property_may_be_said_to_be_what_it_is_anyway() -> None:
    assert not [*iceoptions.examine({"properties": {"Ice.Warn.Connections": 0}})]


def test_an_unquoted_property_is_reported_by_its_full_name() -> None:
    [complaint] = iceoptions.examine({"properties": {"Ice": {"ACM": {"Client": {"Timeout": 5}}}}})
    assert 'write "Ice.ACM.Client.Timeout" in quotes' in complaint.message


def test_a_proxy_is_found_by_the_channels_instance_and_the_longest_name_wins() -> None:
    proxies = {"/robot2/base/Laser": "a", "base/Laser": "b", "base": "c", "Laser": "d"}
    options = IceOptions(proxies=proxies)
    channels = ["robot2/base/Laser/get", "base/Laser/get", "base/Speech/say", "*/Laser/get", "other/Laser/get"]
    assert [options.proxy_of(channel) for channel in channels] == ["a", "b", "c", "d", None]


def test_a_topic_is_called_like_its_interface_behind_its_namespace() -> None:
    options = IceOptions(topics={"ScanPub": "zed/ScanPub", "rear/ScanPub": "rear"})
    channels = ["camera/LaserPub/push", "robot1/left/camera/LaserPub/push", "*/ScanPub/push", "rear/ScanPub/push"]
    assert [options.topic_of(each) for each in channels] == ["LaserPub", "robot1/left/LaserPub", "zed/ScanPub", "rear"]


def test_what_is_provided_is_served_where_its_port_says() -> None:
    options = IceOptions(endpoints={"Laser1": "tcp -p 1", "LaserPubTopic": "tcp -p 2"})
    assert options.endpoint_of("world/Laser1/get") == "tcp -p 1"
    assert options.endpoint_of("world/Laser/get") is None
    assert options.subscriber_endpoint_of("*/LaserPub/push") == "tcp -p 2"
    assert iceoptions.identity_of("world/Laser1/get") == "laser1"
