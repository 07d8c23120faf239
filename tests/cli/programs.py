"""Programs of this package as processes, and networks of shell scripts for them."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from robocomp_py.testing.patience import SOON, wait_until


def network_of(folder: Path, name: str, **programs: str) -> Path:
    """A network of shell scripts."""
    (folder / "program.cdsl").write_text("Component program { language python; };")
    blocks = ""
    for program, text in programs.items():
        script = folder / f"{program}.sh"
        script.write_text(f"#!/bin/sh\n{text}\n")
        script.chmod(0o755)
        blocks += f'    Component {program} : program {{ path "{program}.sh"; }};\n'
    path = folder / f"{name}.ddsl"
    path.write_text(f'import "program.cdsl";\nDeployment {name} {{\n{blocks}}};\n')
    return path


class Program(subprocess.Popen[str]):
    """A program that runs, and what it has said so far."""

    def __init__(self, module: str, *arguments: object) -> None:
        command = [sys.executable, "-m", f"robocomp_py.cli.{module}", *map(str, arguments)]
        super().__init__(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        self.lines: list[str] = []
        self.reader = threading.Thread(target=self._read)
        self.reader.start()

    def _read(self) -> None:
        assert self.stdout is not None
        self.lines.extend(line.rstrip("\n") for line in self.stdout)

    def wait_for(self, *texts: str) -> None:
        def all_said() -> bool:
            return all(any(text in line for line in self.lines) for text in texts)

        wait_until(lambda: all_said() or self.poll() is not None, SOON * 3, ", ".join(texts))
        if self.poll() is not None:
            self.reader.join(SOON)  # its last lines may not have been read yet
        assert all_said(), self.lines


@contextmanager
def running(module: str, *arguments: object) -> Iterator[Program]:
    program = Program(module, *arguments)
    try:
        yield program
        program.wait(SOON * 3)
    finally:
        program.kill()
        program.wait()
        program.reader.join()
        assert program.stdout is not None
        program.stdout.close()


def alive(pid: int) -> bool:
    """Whether a process is there, and no zombie."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False
