"""A program with only Zenoh's library does all that docs/reference/protocol-zenoh.md describes."""

from __future__ import annotations

import contextlib
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from robocomp_py.cli.rc import main as rc
from robocomp_py.contract.interface import Operation, Pattern
from robocomp_py.contract.qos import QoS, Reliability
from robocomp_py.contract.types import FLOAT32, INT32, TIME, Field, Sequence, Struct
from robocomp_py.runtime.calls import type_of
from robocomp_py.testing import everything
from robocomp_py.testing.patience import SOON, wait_until
from robocomp_py.tools.recording.reader import Recording
from robocomp_py.transports.base import Channel, Reply, Status, TransportConfig
from robocomp_py.transports.runtime_folder import runtime_dir
from robocomp_py.transports.zenoh.transport import ZenohTransport
from robocomp_py.wire.cdr import Cdr
from tests.docs.pages import ROOT, blocks
from tests.tools.terse import INTERFACE

HERE = Path(__file__).parent
PAGE = ROOT / "docs" / "reference" / "protocol-zenoh.md"
NONE_OF_OURS = "modules of ours:"

divide, news = everything.divide, everything.news


@pytest.fixture
def transport() -> Iterator[ZenohTransport]:
    opened = ZenohTransport(TransportConfig(owner="component"))
    yield opened
    opened.close()


def channel(operation: Operation[Any], pattern: Pattern, qos: QoS | None = None) -> Channel:
    name = f"plain/Everything/{operation.name}"
    return Channel(name, pattern, type_of(operation, pattern), qos or QoS(), operation.idempotent)


Start = Callable[..., "subprocess.Popen[str]"]


@pytest.fixture
def plain(transport: ZenohTransport) -> Iterator[Start]:
    """Starts the program, in an interpreter in which an import of ours is an error."""
    guarded = "import runpy, sys; sys.modules['robocomp_py'] = None; del sys.argv[0]; runpy.run_path(sys.argv[0])"
    endpoint = f"unixsock-stream/{runtime_dir()}/zenoh/router.sock"
    command = [sys.executable, "-I", "-c", guarded, str(HERE / "plain.py"), endpoint]
    with contextlib.ExitStack() as running:

        def start(*arguments: str) -> subprocess.Popen[str]:
            program = subprocess.Popen([*command, *arguments], text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
            running.enter_context(program)
            running.callback(program.kill)
            return program

        yield start


def told(program: subprocess.Popen[str]) -> list[str]:
    output, _ = program.communicate(timeout=SOON * 3)
    assert program.returncode == 0
    return output.splitlines()


def test_a_plain_program_hears_a_topic(transport: ZenohTransport, plain: Start) -> None:
    outlet = transport.outlet(channel(news, Pattern.PUBLISH))
    program = plain("hear", "*/Everything/news")
    wait_until(lambda: outlet.has_subscribers)  # type: ignore[union-attr]  # a publisher
    outlet.send(transport.codec.encoder(news.request)((7, "hello")))
    assert told(program) == ["heard message 1: 7, hello", NONE_OF_OURS]


def test_a_plain_program_asks_a_query(transport: ZenohTransport, plain: Start) -> None:
    decode, encode = transport.codec.decoder(divide.request), transport.codec.encoder(divide.response)
    serving = channel(divide, Pattern.QUERY)
    transport.server(serving, lambda payload, _: Reply(Status.OK, encode(divmod(*decode(payload)))))
    fingerprint = f"{divide.fingerprint:016x}"
    assert told(plain("ask", serving.name, fingerprint, "17", "5")) == ["status 0 3 2", NONE_OF_OURS]
    assert told(plain("ask", "nobody/Everything/divide", fingerprint, "1", "1")) == ["no answer", NONE_OF_OURS]


def test_a_plain_program_publishes_to_a_component_which_acknowledges(transport: ZenohTransport, plain: Start) -> None:
    decode, heard = transport.codec.decoder(news.request), list[Any]()
    reliable = QoS(Reliability.RELIABLE)
    link = transport.inlet(channel(news, Pattern.PUBLISH, reliable), lambda payload: heard.append(decode(payload)))
    program = plain("publish", "plain/Everything/news", f"{news.fingerprint:016x}", "8", "goodbye")
    assert told(program) == [f"message 1 was taken by {link.id:016x}", NONE_OF_OURS]  # type: ignore[attr-defined]
    assert heard == [(8, "goodbye")]


def test_a_plain_program_serves_a_component(transport: ZenohTransport, plain: Start) -> None:
    asking = channel(divide, Pattern.QUERY)
    program = plain("serve", asking.name, f"{divide.fingerprint:016x}")
    caller = transport.caller(asking)
    assert caller.wait_peer(SOON * 3)
    reply = caller.ask(transport.codec.encoder(divide.request)((17, 5)), SOON)
    assert transport.codec.decoder(divide.response)(reply.payload) == (3, 2)
    assert told(program) == ["answered 17 / 5", NONE_OF_OURS]


def test_tools_find_the_contract_of_a_plain_program_in_an_idsl_file(
    transport: ZenohTransport, plain: Start, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "Everything.idsl").write_text(INTERFACE)
    over = ("--middleware", "zenoh")
    program = plain("serve", "plain/Everything/divide", f"{divide.fingerprint:016x}")
    assert rc(["info", "plain/Everything/divide", *over, "--timeout", str(SOON)]) == 0
    assert "nothing announces the contract of plain/Everything/divide" in capsys.readouterr().out
    question = ("plain/Everything/divide", "dividend=17", "divisor=5")
    assert rc(["call", *question, *over]) == 1
    assert "plain/Everything/divide; name the folder of its IDSL file: -I DIR" in capsys.readouterr().err
    assert rc(["call", *question, *over, "-I", str(tmp_path)]) == 0
    assert capsys.readouterr().out == '{"ret": 3, "remainder": 2}\n'
    assert told(program) == ["answered 17 / 5", NONE_OF_OURS]


def test_tools_hear_a_plain_program_whose_contract_is_in_an_idsl_file(
    transport: ZenohTransport, plain: Start, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "Everything.idsl").write_text(INTERFACE)
    program = plain("publish", "plain/Everything/news", f"{news.fingerprint:016x}", "8", "goodbye")
    words = ["echo", "plain/Everything/news", "-n", "1", "--json", "--middleware", "zenoh", "-I", str(tmp_path)]
    assert rc([*words, "--timeout", str(SOON)]) == 0
    assert '{"number": 8, "text": "goodbye"}' in capsys.readouterr().out
    program.kill()


def test_messages_of_a_plain_program_are_recorded(
    transport: ZenohTransport, plain: Start, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "Everything.idsl").write_text(INTERFACE)
    program = plain("publish", "plain/Everything/news", f"{news.fingerprint:016x}", "8", "goodbye")
    words = ["record", "plain/Everything/news", "-o", str(tmp_path / "run"), "--for", "1", "-I", str(tmp_path)]
    assert rc([*words, "--middleware", "zenoh", "--timeout", str(SOON)]) == 0
    program.kill()
    with Recording(tmp_path / "run") as recording:
        [message] = recording.messages()
        assert message.topic.decoder()(message.data) == (8, "goodbye")


# What the page shows.


def octets(heading: str) -> bytes:
    """Those that the page shows under a heading: hexadecimal, with a comment on each line."""
    [text] = [block for block in blocks(PAGE, "text") if block.startswith(heading)]
    return b"".join(bytes.fromhex(line.split("  ")[0]) for line in text.splitlines()[1:])


def test_the_request_that_the_page_shows_is_one() -> None:
    asked = Struct("Asked", (Field("angles", Sequence(FLOAT32)),))
    assert octets("payload of the request") == bytes(Cdr().encoder(asked)(([0.0, 0.5],)))


def test_the_reply_that_the_page_shows_is_one() -> None:
    echo = Struct("Echo", (Field("distance", FLOAT32), Field("quality", INT32), Field("heard", TIME)))
    answered = Struct("Answered", (Field("ret", Sequence(echo)),))
    assert octets("payload of the reply") == bytes(Cdr().encoder(answered)(([(2.0, 1, 1_700_000_000_000_000_000)],)))
