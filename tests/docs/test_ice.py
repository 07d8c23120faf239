"""The programs of docs/guides/ice.md, run as that page says."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from robocomp_py.testing.patience import SOON

from .pages import ROOT, Command, File, steps

PAGE = ROOT / "docs" / "guides" / "ice.md"


@contextlib.contextmanager
def started(command: str, folder: Path) -> Iterator[subprocess.Popen[str]]:
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    process = subprocess.Popen(
        ["bash", "-c", f"exec {command}"],
        cwd=folder,
        env=os.environ | {"PATH": path},
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
    )
    try:
        yield process
    finally:
        process.send_signal(signal.SIGTERM)
        try:
            process.communicate(timeout=SOON * 3)
        finally:
            process.kill()
            process.wait()


@pytest.mark.tool
def test_a_component_hears_a_program_of_ice_alone_as_the_page_says(tmp_path: Path) -> None:
    typed = list(steps(PAGE))
    assert typed[-1].text == "rc run guard"
    with contextlib.ExitStack() as running:
        for step in typed:
            match step:
                case File():
                    (tmp_path / step.path).parent.mkdir(parents=True, exist_ok=True)
                    (tmp_path / step.path).write_text(step.text, encoding="utf-8")
                case Command(text) if text.endswith(" &"):
                    process = running.enter_context(started(text.removesuffix(" &"), tmp_path))
                    assert process.stdout
                    assert process.stdout.readline().strip() == step.output[0]
                case Command():
                    with started(step.text, tmp_path) as process:
                        output, _ = process.communicate(timeout=SOON * 6)
                    assert step.pattern.fullmatch(output) or (not step.output and not process.returncode), output
                    assert process.returncode == step.exit_code, output
