"""A network of many components on one host, and what it costs: `python -m tests.faults.many [COUNT] [MIDDLEWARE]`.

Every second component offers an interface and publishes a topic; the next one requires the one and subscribes to the
other. So each has one other to find among all of them.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from robocomp_py.deploy.launcher import traces

_IDSL = """
module RoboCompMany
{
    interface Asked { int ask(int number); };
    interface Told { void tell(int number); };
};
"""

_OFFERER = """
import "Many.idsl";
Component offerer
{
    Communications { implements Asked; publishes Told; };
    language python;
    period 1000 ms;
};
"""

_USER = """
import "Many.idsl";
Component user
{
    Communications { requires Asked; subscribesTo Told; };
    language python;
    period 1000 ms;
};
"""

_WORKERS = {
    "offerer": """
from .generic.genericworker import GenericWorker

class SpecificWorker(GenericWorker):
    def compute(self) -> None:
        self.told_proxy.tell(1)

    def Asked_ask(self, number: int) -> int:
        return number + 1
""",
    "user": """
from .generic.genericworker import GenericWorker

class SpecificWorker(GenericWorker):
    def compute(self) -> None:
        assert self.asked_proxy.ask(1) == 2

    def Told_tell(self, number: int) -> None:
        pass
""",
}


@dataclass(frozen=True)
class Cost:
    """Of a network, from the start of rcdeploy to its end."""

    ready_s: float
    stopped_s: float
    memory_mb: float
    """PSS of all its processes, rcdeploy and its helpers included."""
    controller_s: float
    """Processor time of rcdeploy until all was ready."""
    status_s: float
    """How long `rcdeploy status --json` took."""
    left: int
    """Processes that were still there at the end."""
    code: int


def many_components(folder: Path, count: int, middleware: str) -> Path:
    """The DDSL of a network of so many components, generated into a folder."""
    for name, text in (("offerer", _OFFERER), ("user", _USER)):
        home = folder / name
        home.mkdir()
        (home / "Many.idsl").write_text(_IDSL)
        (home / f"{name}.cdsl").write_text(text)
        command = [sys.executable, "-m", "robocomp_py.cli.rcgen", str(home / f"{name}.cdsl")]
        subprocess.run(command, check=True, capture_output=True, text=True)
        (home / "specificworker.py").write_text(_WORKERS[name])
    instances = (_instance(number) for number in range(count))
    network = folder / "many.ddsl"
    network.write_text(
        'import "offerer/offerer.cdsl";\nimport "user/user.cdsl";\n\n'
        f"Deployment many\n{{\n    middleware {middleware};\n{''.join(instances)}}};\n"
    )
    return network


def _instance(number: int) -> str:
    if number % 2 == 0:
        return f"    Component o{number} : offerer {{ }};\n"
    source = f"o{number - 1}"
    return f"    Component u{number} : user {{ requires Asked from {source}; subscribesTo Told from {source}; }};\n"


def cost(network: Path, patience: float = 120.0) -> Cost:
    """Run a network until everything is ready, and stop it."""
    with tempfile.TemporaryDirectory(prefix="rc-", dir="/tmp") as runtime:
        environment = os.environ | {"ROBOCOMP_RUNTIME_DIR": runtime}
        command = [sys.executable, "-m", "robocomp_py.cli.rcdeploy"]
        begun = time.monotonic()
        running = subprocess.Popen(
            [*command, str(network)], env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
        )
        try:
            assert running.stdout
            lines = _lines(running.stdout.fileno(), patience)
            said: list[str] = []
            for line in lines:
                said.append(line)
                if re.search(r"components of \w+ are ready", line):
                    break
            else:
                raise RuntimeError("the network did not come up:\n" + "\n".join(said))
            ready = time.monotonic()
            trace = traces.look(running.pid)
            processes = [running.pid, *descendants(running.pid)]
            memory = sum(map(_memory, processes)) / 1e6
            asked = time.monotonic()
            subprocess.run([*command, "status", "--json", str(network)], env=environment, capture_output=True)
            status = time.monotonic() - asked
            stopping = time.monotonic()
            running.terminate()
            for _ in lines:
                pass
            code = running.wait(patience)
            stopped = time.monotonic()
            left = [pid for pid in processes if (found := traces.look(pid)) and found.state != "Z"]
            cpu = trace.cpu_ticks / os.sysconf("SC_CLK_TCK") if trace else 0.0
            return Cost(ready - begun, stopped - stopping, memory, cpu, status, len(left), code)
        finally:
            running.kill()
            running.wait()


def descendants(pid: int) -> list[int]:
    everybody = list(traces.everybody())
    found: list[int] = []
    new = {pid}
    while new:
        new = {each.pid for each in everybody if each.parent in new}
        found += new
    return found


def _lines(pipe: int, patience: float) -> Iterator[str]:
    end, rest = time.monotonic() + patience, b""
    while chunk := os.read(pipe, 65536):
        *lines, rest = (rest + chunk).split(b"\n")
        for line in lines:
            yield line.decode(errors="replace")
        if time.monotonic() > end:
            raise TimeoutError(f"not in {patience:g} s")


def _memory(pid: int) -> int:
    with contextlib.suppress(OSError):
        found = re.search(rb"^Pss: +(\d+) kB", Path(f"/proc/{pid}/smaps_rollup").read_bytes(), re.MULTILINE)
        return int(found[1]) * 1024 if found else 0
    return 0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("count", type=int, nargs="?", default=500)
    parser.add_argument("middleware", nargs="?", default="zeromq")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="rc-many-", dir="/tmp") as folder:
        print(cost(many_components(Path(folder), options.count, options.middleware)))


if __name__ == "__main__":
    main()
