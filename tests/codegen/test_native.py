"""What is written for programs that know nothing of us is what is there at run time."""

from __future__ import annotations

import json
import re
import struct
import subprocess
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import pytest

from robocomp_py.codegen import omgidl
from robocomp_py.codegen.native import native
from robocomp_py.contract import types as t
from robocomp_py.contract.component import Component, Port
from robocomp_py.contract.interface import Operation, Pattern, Verb
from robocomp_py.runtime import settings
from robocomp_py.runtime.calls import type_of
from robocomp_py.runtime.run import Running
from robocomp_py.testing import everything
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.transports.base import Channel, Transport, TransportConfig, TransportFactory, find_transport
from robocomp_py.transports.dds import types as dds_types
from robocomp_py.wire import header
from robocomp_py.wire.messagepack import MessagePack

from .descriptions import Description, of_c, of_class, of_idl
from .generated import golden_model, linked, loaded, model_in
from .golden import GOLDEN

MIDDLEWARES = ("zeromq", "zenoh", "dds")
ABOUT = "Generated from test.cdsl by rcgen 0: edits are lost."

AWKWARD = """
module Native
{
    // Ends in a backslash \\
    enum Any { default, Object, _hidden };
    struct Sequence { int sequence; float Float; Any any; string _text; Point Point; };
    struct Point { float x; float y; };      // µ
    struct Time { time time; sequence<time> times; };
    dictionary<int, sequence<Point>> Map;
    exception Exception { string exception; Point header; };
    exception Worse extends Exception { Map map; };
    interface Odd
    {
        sequence<Map> octet(int header, sequence<Sequence> items, out int error) throws Worse, Exception;
        void header(sequence<sequence<Time>> header, Other::Native Native, Other::Native other, int robocomp, time t);
        [command] void void_();
        [publish] void module(byte long, int8 unsigned, bool boolean, Other::Native Other);
    };
};
"""
OTHER = "module Other { struct Native { double Other; }; };"


@pytest.fixture(scope="module")
def awkward(tmp_path_factory: pytest.TempPathFactory) -> Component:
    """Names that IDL has taken, and members called like types."""
    folder = tmp_path_factory.mktemp("awkward")
    ports = "implements Odd; publishes Odd; subscribesTo Odd;"
    cdsl = f'import "Native.idsl"; Component odd {{ language python; Communications {{ {ports} }}; }};'
    model_in(folder, Native_idsl='import "Other.idsl";' + AWKWARD, Other_idsl=OTHER, odd_cdsl=cdsl)
    return linked(folder / "odd.cdsl").component


@pytest.fixture(params=["everything", "names", "conformance", "awkward"])
def component(request: pytest.FixtureRequest, awkward: Component) -> Component:
    """Every type, every pattern, and every kind of name."""
    return component_called(request.param, awkward)


def component_called(name: str, awkward: Component) -> Component:
    if name == "awkward":
        return awkward
    if name == "conformance":
        ports = (Port(verb, everything.EVERYTHING) for verb in (Verb.IMPLEMENTS, Verb.PUBLISHES))
        return Component("conformance", tuple(ports))
    return golden_model(name).component


def written(component: Component, middleware: str) -> dict[str, str]:
    """Files by name."""
    prefix = f"generic/{middleware}/"
    files = native(component, middleware, ABOUT)
    return {path.removeprefix(prefix): text for path, text in files.items() if path.startswith(prefix)}


def types_in(files: dict[str, str]) -> dict[str, str]:
    return {name: text for name, text in files.items() if name.endswith(".idl")}


def channels(component: Component, middleware: str) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = json.loads(written(component, middleware)["channels.json"])["channels"]
    return found


def used(component: Component, middleware: str) -> Iterator[tuple[Operation[Any], Pattern]]:
    for port in component.ports:
        if port.middleware in (None, middleware):
            yield from port.interface.under(port.verb)


def topic_types(component: Component) -> Description:
    """What the DDS transport registers for a component."""
    found = of_class(dds_types.credit_type())
    for operation, pattern in used(component, "dds"):
        kind = type_of(operation, pattern)
        if pattern is Pattern.PUBLISH:
            found |= of_class(dds_types.publication_type(kind.name, kind.request))
            continue
        found |= of_class(dds_types.request_type(kind.name, kind.request))
        if kind.response:
            found |= of_class(dds_types.reply_type(kind.response.name, kind.response))
    return found


# Types.


def test_the_idl_for_dds_describes_the_types_of_the_topics(component: Component) -> None:
    """And beside them nothing but what may be in the `error` of a reply."""
    said, there = of_idl(types_in(written(component, "dds"))), topic_types(component)
    assert {name: said.get(name) for name in there} == there
    thrown = [each for operation, _ in used(component, "dds") for each in operation.raises]
    parts = of_idl(omgidl.idl([], map(omgidl.exception, thrown), ABOUT))
    ours = {f"robocomp::{name}" for name in ("RequestHeader", "ReplyHeader", "PublicationHeader", "Time", "Failure")}
    assert said.keys() - there.keys() <= parts.keys() | ours


def test_a_generated_component_registers_the_types_that_its_idl_describes() -> None:
    component = loaded(GOLDEN / "everything").component
    assert topic_types(component) == topic_types(component_called("everything", component))


def test_a_header_is_the_first_member_and_an_error_the_last_one_of_a_reply(awkward: Component) -> None:
    said = of_idl(types_in(written(awkward, "dds")))
    assert said["Native::OddOctetRequest"] == (
        ("header", "robocomp::RequestHeader"),
        ("header_", "int32"),
        ("items", "sequence<Native::Sequence>"),
    )
    assert said["Native::OddOctetResponse"] == (
        ("header", "robocomp::ReplyHeader"),
        ("ret", "sequence<sequence<Native::MapEntry>>"),
        ("error", "int32"),
        ("error_", "sequence<uint8>"),
    )


def test_the_idl_for_zenoh_describes_the_same_without_header(component: Component) -> None:
    """What is behind the header of a sample is a payload."""
    component = replace(component, ports=tuple(replace(port, middleware=None) for port in component.ports))
    samples, payloads = (of_idl(types_in(written(component, middleware))) for middleware in ("dds", "zenoh"))
    assert payloads
    for name, members in payloads.items():
        first, *_ = sample = samples[name]
        if first[0] == "header" and first[1].startswith("robocomp::"):
            end = -1 if name.endswith("Response") else None
            assert [kind for _, kind in sample[1:end]] == [kind for _, kind in members]
        else:
            assert sample == members


def test_modules_that_need_each_other_share_a_file() -> None:
    """They may, if one of them is made of several IDSL files."""
    inner = t.Struct("Left::Inner", (t.Field("x", t.INT32),))
    middle = t.Struct("Right::Middle", (t.Field("inner", inner),))
    outer = t.Struct("Left::Outer", (t.Field("middle", middle), t.Field("time", t.TIME)))
    texts = omgidl.idl([outer], [], ABOUT)
    assert list(texts) == ["Left.idl", "robocomp.idl"]
    assert re.findall(r"^#include .*|^module \w+|struct \w+", texts["Left.idl"], re.MULTILINE) == [
        '#include "robocomp.idl"',
        *("module Left", "struct Inner", "module Right", "struct Middle", "module Left", "struct Outer"),
    ]
    assert of_idl(texts)["Left::Outer"] == (("middle", "Right::Middle"), ("time", "robocomp::Time"))


def test_what_compilers_may_complain_of_is_said_at_the_beginning() -> None:
    def head(*fields: str, name: str = "Point") -> str:
        text = omgidl.idl([t.Struct(f"Arm::{name}", tuple(t.Field(each, t.INT32) for each in fields))], [], ABOUT)
        return text["Arm.idl"].partition("\n\n")[0]

    assert head("x", "y") == f"// {ABOUT}"
    assert "differ only in case" in head("x", "X")
    assert head("x", "X").endswith(": X, x.")
    assert "defined twice in one scope" in head("Point")
    assert "defined twice in one scope" in head("x", name="Arm")
    assert "defined twice in one scope" in head("x", name="Final")


def test_a_name_that_stands_for_two_types_is_said_to(tmp_path: Path) -> None:
    """A struct may be called like a message; each of them travels well, but no list of types can have both."""
    idsl = "module Arm { struct ArmMoveRequest { int x; }; interface Arm { void move(ArmMoveRequest how); }; };"
    cdsl = 'import "Arm.idsl"; Component arm { language python; Communications { implements Arm; }; };'
    component = linked(model_in(tmp_path, Arm_idsl=idsl, arm_cdsl=cdsl)).component
    assert json.loads(written(component, "zeromq")["channels.json"])["ambiguous"] == ["Arm::ArmMoveRequest"]
    assert (
        "are defined twice in one scope, which IDL does not allow: ArmMoveRequest"
        in (written(component, "zenoh")["Arm.idl"].partition("\n\n")[0])
    )


# Lists.


class Noting:
    """Has transports note the channels they are asked for: middleware, name, verb, fingerprint."""

    def __init__(self) -> None:
        self.noted: set[tuple[str, ...]] = set()

    def find(self, name: str) -> TransportFactory:
        def open_it(config: TransportConfig) -> Transport:
            transport: Any = find_transport(name)(config)
            for verb in ("outlet", "inlet", "caller", "server"):
                setattr(transport, verb, self._noting(name, verb, getattr(transport, verb)))
            return transport  # type: ignore[no-any-return]

        return open_it

    def _noting(self, middleware: str, verb: str, do: Callable[..., Any]) -> Callable[..., Any]:
        def noted(channel: Channel, *rest: Any) -> Any:
            link = do(channel, *rest)
            self.noted.add((middleware, channel.name, verb, f"{channel.type.fingerprint:016x}"))
            return link

        return noted


@pytest.fixture(params=MIDDLEWARES)
def middleware(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def test_the_channels_listed_are_those_a_component_uses(middleware: str) -> None:
    worker, noting = loaded(GOLDEN / "everything"), Noting()
    document = settings.Document({"middleware": middleware, "params": {"device": "none"}})
    verbs = {("query", "in"): "server", ("query", "out"): "caller"}
    listed = {
        (
            middleware,
            each["channel"],
            verbs.get((each["pattern"], direction), {"in": "inlet", "out": "outlet"}[direction]),
            each["fingerprint"],
        )
        for each in channels(worker.component, middleware)
        for direction in [each["messages"][0]["direction"]]
    }
    made = Running(worker, settings.check(worker.component, document), noting.find)
    thread = threading.Thread(target=made.run)
    thread.start()  # it will wait for what it requires; its channels are open then
    try:
        wait_until(lambda: noting.noted >= listed, what="all channels that are listed")
    finally:
        made.stop()
        thread.join(SOON)
    others = {each[1].split("/")[-2] for each in noting.noted - listed if each[0] == middleware}
    assert others <= {"CommonBehavior", "Introspection"}


def test_the_headers_listed_are_those_that_travel() -> None:
    listed = parsed(GOLDEN / "everything")["headers"]
    letters = {"uint8": "B", "uint32": "I", "uint64": "Q", "int64": "q"}
    packed = {
        "request": (header.pack_request(2, 3, 4, 5, 0.006), (1, 2, 3, 4, 5, 6)),
        "reply": (header.pack_reply(2, 3, 4, 5), (1, 2, 3, 4, 5)),
        "publication": (header.pack_publication(2, 3, 4, -5), (1, 2, 3, 4, -5)),
    }
    read = {"request": header.Request, "reply": header.ReplyHeader, "publication": header.Publication}
    assert listed.keys() == packed.keys()
    for kind, (octets, values) in packed.items():
        layout = "<" + "".join(letters[width] for _, width in listed[kind])
        assert dict(zip([name for name, _ in listed[kind]], struct.unpack(layout, octets), strict=True)) == dict(
            zip(read[kind]._fields, values, strict=True)  # type: ignore[attr-defined]  # named tuples
        )


def parsed(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((folder / "generic" / "zeromq" / "channels.json").read_text())
    return found


def test_a_message_can_be_written_and_read_by_its_layout_alone() -> None:
    """With the list of channels and msgpack alone."""
    types = parsed(GOLDEN / "everything")["types"]
    everything_in = native(Component("c", (Port(Verb.IMPLEMENTS, everything.EVERYTHING),)), "zeromq", ABOUT)
    types |= json.loads(everything_in["generic/zeromq/channels.json"])["types"]
    operations = [*golden_model("everything").component.ports, Port(Verb.IMPLEMENTS, everything.EVERYTHING)]
    read = 0
    for port in operations:
        for operation, pattern in port.interface.under(port.verb):
            if pattern is not Pattern.PUBLISH:
                value = written_by(operation.request.name, types)
                values = MessagePack().decoder(operation.request)([msgpack.packb(value)])
                [again, *more] = MessagePack().encoder(operation.request)(values)
                assert not more
                assert fits(msgpack.unpackb(again, strict_map_key=False), operation.request.name, types)
                read += 1
    assert read > 20


_SCALARS: dict[str, Any] = {"bool": True, "string": "text", "float32": 0.5, "float64": 0.25}


def written_by(kind: str, types: dict[str, Any]) -> Any:
    """A value of a type; every sequence and dictionary has an item."""
    if kind in types:
        if "enumeration" in types[kind]:
            return next(iter(types[kind]["enumeration"].values()))
        return [written_by(inside, types) for _, inside in types[kind]["struct"]]
    if found := re.fullmatch(r"sequence<(.*)>", kind):
        return [written_by(found[1], types)]
    if found := re.fullmatch(r"dictionary<([^,]*),(.*)>", kind):
        return {written_by(found[1], types): written_by(found[2], types)}
    return _SCALARS.get(kind, 7)


def fits(value: Any, kind: str, types: dict[str, Any]) -> bool:
    """Whether a value is what `written_by` writes; arrays of numbers are packed."""
    expected = written_by(kind, types)
    if isinstance(value, msgpack.ExtType):
        letter, item = value.data[:1].decode(), np.frombuffer(value.data[1:], f"<{chr(value.data[0])}")
        return letter in "?bBhHiIqQfd" and item.tolist() == expected
    if isinstance(value, bytes):
        return list(value) == expected
    if kind in types and "struct" in types[kind]:
        members = types[kind]["struct"]
        return len(value) == len(members) and all(
            fits(part, inside, types) for part, (_, inside) in zip(value, members, strict=True)
        )
    if found := re.fullmatch(r"sequence<(.*)>", kind):
        return len(value) == 1 and fits(value[0], found[1], types)
    if found := re.fullmatch(r"dictionary<([^,]*),(.*)>", kind):
        return list(value) == list(expected) and all(fits(each, found[2], types) for each in value.values())
    return bool(value == expected)


def test_every_type_that_is_named_is_described(component: Component, middleware: str) -> None:
    files = written(component, middleware)
    listed = json.loads(files["channels.json"])
    named = {message["type"] for each in listed["channels"] for message in each["messages"]}
    named |= {name for each in listed["channels"] for name in each.get("raises", ())}
    described = listed["types"] if middleware == "zeromq" else of_idl(types_in(files))
    assert named
    assert named <= described.keys()
    assert listed.get("idl", []) == sorted(types_in(files))


def test_a_port_with_a_middleware_of_its_own_is_described_where_it_belongs() -> None:
    component = golden_model("everything").component
    mixed = replace(
        component,
        ports=tuple(
            replace(port, middleware="dds" if port.interface.short == "News" else None) for port in component.ports
        ),
    )
    files = native(mixed, "zenoh", ABOUT)
    assert {path.split("/")[1] for path in files} == {"dds", "zenoh"}
    assert {each["channel"].split("/")[1] for each in channels(mixed, "dds") if "zenoh" not in each} >= {"News"}
    assert "News" not in files["generic/zenoh/channels.json"]
    assert "struct NewsToldPublication" in files["generic/dds/Everything.idl"]


@pytest.mark.parametrize("middleware", ["inproc", "counting"])
def test_where_no_other_programs_are_nothing_is_written(middleware: str) -> None:
    component = golden_model("everything").component
    assert native(component, middleware, ABOUT) == {}


# What the compiler of Debian's Cyclone DDS makes of the IDL.


def compiled(files: dict[str, str], folder: Path, *options: str) -> tuple[str, Description]:
    """What idlc says of each file, and the types that it finds."""
    said, found = "", {}
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")
    for name in files:
        command = ["idlc", *options, "-l", "c", "-o", str(folder), str(folder / name)]
        done = subprocess.run(command, capture_output=True, text=True)
        said += done.stdout + done.stderr
        if done.returncode == 0:
            found |= of_c((folder / name).with_suffix(".c").read_text())
    return said, found


@pytest.mark.tool
@pytest.mark.parametrize("kind", ["everything", "conformance", "awkward"])
def test_the_compiler_finds_the_types_that_are_registered_at_run_time(
    kind: str, awkward: Component, tmp_path: Path
) -> None:
    component = component_called(kind, awkward)
    said, found = compiled(types_in(written(component, "dds")), tmp_path, "-f", "case-sensitive")
    there = topic_types(component)
    assert said == ""
    assert {name: found.get(name) for name in there} == there


@pytest.mark.tool
@pytest.mark.parametrize("kind", ["everything", "conformance", "awkward"])
def test_the_compiler_takes_the_idl_for_zenoh(kind: str, awkward: Component, tmp_path: Path) -> None:
    files = types_in(written(component_called(kind, awkward), "zenoh"))
    said, found = compiled(files, tmp_path, "-f", "case-sensitive")
    described = of_idl(files)
    assert said == ""
    assert found == {name: described[name] for name in found}
    assert {name for name in described if name.endswith(("Request", "Response", "Publication"))} <= found.keys()


@pytest.mark.tool
def test_the_compiler_complains_of_names_where_the_file_says_that_it_may(tmp_path: Path) -> None:
    component = golden_model("names").component
    files = types_in(written(component, "dds"))
    said, _ = compiled(files, tmp_path)
    assert "collides" in said
    for name, text in files.items():
        complained = f"{name}:" in said
        assert complained == ("differ only in case" in text or "defined twice in one scope" in text), name
