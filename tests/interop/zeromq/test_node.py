"""A Node.js program subscribes and calls, as docs/reference/protocol-zeromq.md describes."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from robocomp_py.contract.types import FLOAT32, INT32, TIME, Field, Sequence, Struct
from robocomp_py.testing.patience import SOON
from robocomp_py.transports.base import Status
from robocomp_py.transports.runtime_folder import runtime_dir
from robocomp_py.transports.zeromq.frames import read_reply_frames, read_request_frames
from robocomp_py.wire.messagepack import MessagePack
from tests.docs.pages import ROOT, File, blocks, steps
from tests.docs.test_native import PAGE as NATIVE
from tests.docs.test_native import started

HERE = Path(__file__).parent
PAGE = ROOT / "docs" / "reference" / "protocol-zeromq.md"


@pytest.mark.tool
def test_a_program_in_node_hears_and_asks(tmp_path: Path) -> None:
    for step in steps(NATIVE):
        if isinstance(step, File) and step.path.startswith("sonar/"):
            path = tmp_path / step.path
            path.parent.mkdir(exist_ok=True)
            path.write_text(step.text, encoding="utf-8")
    for name in ("package.json", "package-lock.json", ".npmrc", "talk.mjs"):
        shutil.copy(HERE / name, tmp_path)
    run(tmp_path, "npm", "ci", "--silent")
    run(tmp_path, "rcgen", "sonar/sonar.cdsl", "--middleware", "zeromq")
    with started("exec rc run sonar", tmp_path) as sonar:
        assert sonar.stdout is not None
        assert any("ready" in line for line in sonar.stdout)
        told = run(tmp_path, "node", "talk.mjs", str(runtime_dir()), "sonar/generic/zeromq/channels.json")
    assert told.splitlines() == [
        "heard 2.0 m, quality 1",
        "scanned 2.00, 2.28",
        "status 1: RoboCompSonar::OutOfRange, 1.25",
    ]


def run(folder: Path, *call: str) -> str:
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environment = os.environ | {"PATH": path}
    done = subprocess.run(call, cwd=folder, env=environment, capture_output=True, text=True, timeout=SOON * 10)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def octets(heading: str) -> bytes:
    """Those that the page shows under a heading: hexadecimal, with a comment on each line."""
    [text] = [block for block in blocks(PAGE, "text") if block.startswith(heading)]
    return b"".join(bytes.fromhex(line.split("  ")[0]) for line in text.splitlines()[1:])


def test_the_request_that_the_page_shows_is_one() -> None:
    named, request, payload = read_request_frames([octets("request")])
    [scan] = [json.loads(block) for block in blocks(NATIVE, "json")]
    assert (named, request.fingerprint) == (b"sonar/Sonar/scan\0", int(scan["fingerprint"], 16))
    assert (request.flags, request.client, request.sequence, request.remaining_ms) == (0, 0x0123456789ABCDEF, 1, 5000)
    decode = MessagePack().decoder(Struct("Asked", (Field("angles", Sequence(FLOAT32)),)))
    assert decode(payload)[0].tolist() == [0.0, 0.5]


def test_the_reply_that_the_page_shows_is_one() -> None:
    reply, payload = read_reply_frames([octets("reply")])
    assert (reply.status, reply.client, reply.sequence) == (Status.OK, 0x0123456789ABCDEF, 1)
    echo = Struct("Echo", (Field("distance", FLOAT32), Field("quality", INT32), Field("heard", TIME)))
    decode = MessagePack().decoder(Struct("Answered", (Field("ret", Sequence(echo)),)))
    assert decode(payload) == ([(2.0, 1, 1_700_000_000_000_000_000)],)


def test_the_program_has_the_length_of_a_page() -> None:
    program = (HERE / "talk.mjs").read_text(encoding="utf-8")
    assert len(program.splitlines()) < 50
    assert "robocomp" not in program.replace("RoboComp", "")


@pytest.mark.parametrize("folder", ["zeromq", "mcap"])
def test_the_lock_file_says_what_to_get_and_not_from_where(folder: str) -> None:
    packages = json.loads((HERE.parent / folder / "package-lock.json").read_text())["packages"]
    assert [name for name, each in packages.items() if name and "integrity" not in each] == []
    assert [name for name, each in packages.items() if "resolved" in each] == []
