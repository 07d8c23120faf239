"""A reader of the documentation, which does what a page says: writes its files, and runs its commands."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path

from robocomp_py.testing.patience import SOON, wait_until

from .pages import Command, File, steps

AWAITED = re.compile(r"^(?!rcdeploy simulate).*--for |rcdeploy logs |rc logs |rc doctor ")
"""What shows what others have done until then: on a slow machine, nothing yet."""


def follow(page: Path, folder: Path) -> int:
    """Do all steps of a page, and return their number."""
    done = list(steps(page))
    for step in done:
        do(step, folder)
    return len(done)


def do(step: File | Command, folder: Path, **variables: str) -> None:
    """Do one. Raise AssertionError if a command does not print what the page shows, or ends otherwise."""
    if isinstance(step, File):
        path = folder / step.path
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(step.text, encoding="utf-8")
        return
    output, code = run(step, folder, **variables)
    for _ in range(3):
        if step.pattern.match(output) or not AWAITED.search(step.text) or code not in (0, step.exit_code):
            break
        print(output)
        step = replace(step, text=re.sub(r"--for (\S+)", lambda found: f"--for {2 * float(found[1]):g}", step.text))
        output, code = run(step, folder, **variables)
    assert step.pattern.match(output), f"$ {step.text}\n{output}\n--- expected:\n" + "\n".join(step.output)
    assert code == (130 if step.interrupted else step.exit_code), output


def run(step: Command, folder: Path, **variables: str) -> tuple[str, int]:
    """What it prints, and its exit code."""
    environment = os.environ | {
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        "PYTEST_ADDOPTS": "-p no:cacheprovider",
        "COLUMNS": "120",
        **variables,
    }
    process = subprocess.Popen(
        ["bash", "-c", f"exec {step.text}"], cwd=folder, env=environment, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip
    said: list[str] = []
    assert process.stdout is not None
    reader = threading.Thread(target=said.extend, args=(process.stdout,))
    reader.start()
    try:
        if step.interrupted:
            wait_until(lambda: step.pattern.match("".join(said)), SOON * 3, f"{step.text}: {step.output}")
            process.send_signal(signal.SIGINT)
        process.wait(SOON * 6)
    except subprocess.TimeoutExpired as exc:
        raise AssertionError(
            f"$ {step.text}\nhas not ended after {exc.timeout:g} s; printed so far: {''.join(said)}"
        ) from exc
    finally:
        process.kill()
        process.wait()
        reader.join()
        process.stdout.close()
    return "".join(said), process.returncode
