"""The programs of examples/ice, run as docs/reference/protocol-ice.md says, and the bytes that it shows."""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from robocomp_py.testing.patience import SOON
from robocomp_py.wire.header import Flag, read_request
from tests.docs.pages import ROOT, Command, blocks, steps

pytestmark = pytest.mark.tool

PAGE = ROOT / "docs" / "reference" / "protocol-ice.md"


def shell(command: str, folder: Path) -> subprocess.Popen[str]:
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    return subprocess.Popen(
        ["bash", "-c", command],
        cwd=folder,
        env=os.environ | {"PATH": path},
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        start_new_session=True,
    )


def stop(program: subprocess.Popen[str]) -> None:
    with contextlib.suppress(ProcessLookupError):
        os.killpg(program.pid, signal.SIGTERM)
    try:
        program.communicate(timeout=SOON * 3)
    finally:
        program.kill()
        program.wait()


def test_the_programs_of_the_page_ask_and_are_asked(tmp_path: Path) -> None:
    shutil.copytree(ROOT / "examples" / "ice", tmp_path, dirs_exist_ok=True)
    with contextlib.ExitStack() as running:
        for step in steps(PAGE):
            if not isinstance(step, Command):
                continue
            command = step.text.removesuffix(" &")
            program = shell(command, tmp_path)
            if command != step.text:
                running.callback(stop, program)
                assert program.stdout is not None
                assert any("ready" in line for line in program.stdout), f"$ {step.text}"
                continue
            output, _ = program.communicate(timeout=SOON * 6)
            assert step.pattern.fullmatch(output), output
            assert program.returncode == step.exit_code, output


def test_the_header_that_the_page_shows_is_one() -> None:
    [text] = blocks(PAGE, "text")
    first, *lines = text.splitlines()
    [told] = re.findall(r'rc = "([0-9a-f]+)"', first)
    assert bytes.fromhex(told) == b"".join(bytes.fromhex(line.split("  ")[0]) for line in lines)
    request = read_request(bytes.fromhex(told))
    assert (request.flags, request.fingerprint, request.client) == (
        Flag.IDEMPOTENT,
        0xCB1EA11F64949FE5,
        0x0123456789ABCDEF,
    )
    assert (request.sequence, request.remaining_ms) == (1, 5000)
