"""The programs of examples/native, run as docs/guides/native.md says: none of them knows robocomp_py."""

from __future__ import annotations

import contextlib
import json
import os
import re
import shutil
import signal
import struct
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgpack
import pytest
import zenoh
import zmq

from robocomp_py.contract.interface import Pattern
from robocomp_py.runtime.calls import type_of
from robocomp_py.testing import everything
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.transports.base import Channel, Transport, TransportConfig, find_transport
from robocomp_py.transports.runtime_folder import runtime_dir

from .pages import ROOT, Command, File, blocks, steps

PAGE = ROOT / "docs" / "guides" / "native.md"
PROGRAMS = ROOT / "examples" / "native"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """The component of the page, and the programs."""
    shutil.copytree(PROGRAMS, tmp_path, dirs_exist_ok=True)
    for step in steps(PAGE):
        if isinstance(step, File):
            path = tmp_path / step.path
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(step.text, encoding="utf-8")
    return tmp_path


def commands(heading: str, folder: Path) -> list[Command]:
    """What is typed in one section."""
    _, _, rest = PAGE.read_text(encoding="utf-8").partition(f"# {heading}\n")
    section = folder / "section.md"
    section.write_text(re.split(r"^##", rest, maxsplit=1, flags=re.MULTILINE)[0], encoding="utf-8")
    return [step for step in steps(section) if isinstance(step, Command)]


@contextlib.contextmanager
def started(command: str, folder: Path) -> Iterator[subprocess.Popen[str]]:
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    process = subprocess.Popen(
        ["bash", "-c", command],
        cwd=folder,
        env=os.environ | {"PATH": path},
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        start_new_session=True,
    )
    try:
        yield process
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGTERM)
        try:
            process.communicate(timeout=SOON * 3)
        finally:
            process.kill()
            process.wait()


def run_all(typed: list[Command], folder: Path) -> None:
    with contextlib.ExitStack() as running:
        for command in typed:
            text = command.text.removesuffix(" &")
            if text != command.text:
                process = running.enter_context(started(text, folder))
                assert process.stdout is not None
                assert any("ready" in line for line in process.stdout), f"$ {command.text}"
                continue
            with started(text, folder) as process:
                output, _ = process.communicate(timeout=SOON * 6)
            assert command.pattern.fullmatch(output) or (not command.output and not process.returncode), output
            assert process.returncode == command.exit_code, output


@pytest.mark.parametrize("heading", ["ZeroMQ", "Zenoh", "In Python"])
def test_a_program_hears_and_asks_with_the_library_of_its_middleware_alone(heading: str, folder: Path) -> None:
    typed = commands(heading, folder)
    assert typed[-1].output[0].startswith("heard ")
    run_all(typed, folder)


@pytest.mark.tool
def test_a_program_in_c_hears_and_asks(folder: Path) -> None:
    """With types that Debian's idlc made of the IDL."""
    typed = commands("In C", folder)
    assert typed[-1].output[0].startswith("heard ")
    run_all(typed, folder)


def test_no_program_imports_us() -> None:
    programs = [path.read_text(encoding="utf-8") for path in PROGRAMS.glob("listen_*")]
    assert len(programs) == 4
    assert not [text for text in programs if "import robocomp" in text or "from robocomp" in text]


def generated(folder: Path, middleware: str, name: str) -> str:
    with started(f"rcgen sonar/sonar.cdsl --middleware {middleware}", folder) as process:
        output, _ = process.communicate(timeout=SOON * 3)
    assert process.returncode == 0, output
    return (folder / "sonar" / "generic" / middleware / name).read_text()


def test_what_the_page_shows_of_the_lists_and_types_is_what_is_written(folder: Path) -> None:
    [channel], [request] = blocks(PAGE, "json"), blocks(PAGE, "idl")
    assert json.loads(channel) in json.loads(generated(folder, "zeromq", "channels.json"))["channels"]
    assert request in generated(folder, "dds", "RoboCompSonar.idl")


@pytest.fixture
def told() -> list[Any]:
    return []


def command_header() -> bytes:
    """As the page has it, with flag 1."""
    return struct.pack("<BBQQQI", 1, 1, everything.poke.fingerprint, 99, 1, 5000)


def serving(transport: Transport, told: list[Any]) -> str:
    """Have a transport take a command; the name of its channel."""
    kind = type_of(everything.poke, Pattern.COMMAND)
    decode = transport.codec.decoder(everything.poke.request)
    name = f"native{os.getpid()}/Everything/poke"
    transport.inlet(Channel(name, Pattern.COMMAND, kind), lambda payload: told.append(decode(payload)))
    return name


def test_a_command_is_put_to_its_key_in_zenoh(told: list[Any]) -> None:
    transport = find_transport("zenoh")(TransportConfig())
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([f"unixsock-stream/{runtime_dir()}/zenoh/router.sock"]))
    try:
        name = serving(transport, told)
        with zenoh.open(config) as session:
            session.put(f"rc/0/{name}", b"\0\1\0\0" + struct.pack("<i", 7), attachment=command_header())
            wait_until(lambda: told == [(7,)])
    finally:
        transport.close()


def test_a_zeromq_command_goes_to_its_server(told: list[Any]) -> None:
    transport = find_transport("zeromq")(TransportConfig())
    try:
        name = serving(transport, told)
        entries = [
            entry
            for file in (runtime_dir() / "zeromq").glob("*.json")
            for entry in json.loads(file.read_text())["entries"]
        ]
        [address] = [each["address"] for each in entries if (each["role"], each["channel"]) == ("receives", name)]
        with zmq.Context() as context, context.socket(zmq.DEALER) as socket:
            socket.connect(address)
            socket.send(name.encode() + b"\0" + command_header() + msgpack.packb([7]))
            wait_until(lambda: told == [(7,)])
    finally:
        transport.close()
