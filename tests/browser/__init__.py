"""Chromium, driven by lines of JSON: see browser.mjs."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from robocomp_py.testing.patience import SOON

HERE = Path(__file__).parent


@contextmanager
def started(folder: Path, *command: str, **more: Any) -> Iterator[subprocess.Popen[str]]:
    """A process of this command, which ends with this."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    with subprocess.Popen(command, cwd=folder, env=os.environ | {"PATH": path}, text=True, **more) as process:
        try:
            yield process
        finally:
            process.terminate()
            try:
                process.wait(SOON)
            except subprocess.TimeoutExpired:
                process.kill()


class Browser:
    """Steps in a browser, by the names that browser.mjs has for them."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self._process = process

    def __call__(self, **step: Any) -> Any:
        assert self._process.stdin
        assert self._process.stdout
        self._process.stdin.write(json.dumps(step) + "\n")
        self._process.stdin.flush()
        line = self._process.stdout.readline()
        assert line, f"the browser ended at {step}"
        return json.loads(line)


@contextmanager
def browsing(folder: Path, url: str) -> Iterator[Browser]:
    """A browser at a page. `folder` gets what the driver of the browser needs."""
    chromium = shutil.which("chromium")
    assert chromium, "install chromium"
    if not (folder / "node_modules").exists():
        for name in ("package.json", "package-lock.json", ".npmrc", "browser.mjs"):
            shutil.copy(HERE / name, folder)
        with started(folder, "npm", "ci", "--silent") as installing:
            assert installing.wait(SOON * 10) == 0
    piped: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with started(folder, "node", "browser.mjs", chromium, **piped) as driver:
        browser = Browser(driver)
        assert browser(open=url) == 200
        yield browser
        assert driver.stdin
        driver.stdin.close()
        driver.wait(SOON)
