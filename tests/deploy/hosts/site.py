"""A user of this machine with a network over several hosts, which are those of a `Laboratory`."""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path

from robocomp_py.cli.rcgen import main as rcgen
from robocomp_py.testing.patience import SOON, wait_until
from tests.deploy.laboratory import Host, Laboratory, SshServer, make_key

LONG = 9 * SOON
"""Hosts are reached, components started, and each other found."""


_FUTURE = "from __future__ import annotations\n"


def generate(root: Path, name: str, model: str, code: str, imports: str = "") -> None:
    """A component in a folder of its own below `root`; `code` is the body of its class."""
    path = root / name / f"{name}.cdsl"
    path.parent.mkdir()
    path.write_text(model)
    assert rcgen([str(path)]) == 0
    worker = path.parent / "specificworker.py"
    text = worker.read_text()
    head = text[: text.index("    def ")].replace("from __future__ import annotations\n", f"{_FUTURE}\n{imports}\n")
    worker.write_text(head + code)


@contextlib.contextmanager
def laid_out(components: Path) -> Iterator[Site]:
    """A site in a laboratory, of which nothing is left afterwards."""
    short = Path(tempfile.mkdtemp(prefix="lab-", dir="/tmp"))  # paths of sockets have 107 bytes
    try:
        with Laboratory() as laboratory, contextlib.closing(Site(laboratory, short, components)) as made:
            yield made
        assert laboratory.left() == []
    finally:
        shutil.rmtree(short, ignore_errors=True)


class Site:
    """A laboratory, hosts in it, and a user of this machine who is let in there."""

    def __init__(self, laboratory: Laboratory, folder: Path, components: Path) -> None:
        self._laboratory, self.folder, self._components = laboratory, folder, components
        self.of_hosts: dict[str, str] = {}
        """Environment variables of those who log in at hosts."""
        self.hosts: dict[str, Host] = {}
        self.servers: dict[str, SshServer] = {}
        self.runs: list[Rcdeploy] = []
        own = folder / "me" / ".ssh"
        own.mkdir(parents=True)
        self._key = own / "id_ed25519"
        make_key(self._key)
        run = folder / "run"
        run.mkdir(mode=0o700)
        dropped = ("XDG_CONFIG_HOME", "SSH_AUTH_SOCK", "XDG_RUNTIME_DIR", "CYCLONEDDS_URI")
        self._environment = {name: value for name, value in os.environ.items() if name not in dropped}
        self._environment |= {"HOME": str(folder / "me"), "ROBOCOMP_RUNTIME_DIR": str(run), "COLUMNS": "200"}

    def host(self, name: str, *, serves: bool = True, trusted: bool = True) -> Host:
        self.hosts[name] = host = self._laboratory.host(name)
        if serves:
            self.servers[name] = SshServer(host, self.folder / name, self._key, self.of_hosts)
        if serves and trusted:
            with (self.folder / "me" / ".ssh" / "known_hosts").open("a") as known:
                known.write(f"{host.address} {self.servers[name].public_key}\n")
        return host

    def network(self, instances: str, said: str = "", *, called: str = "Lab", **of_hosts: str) -> Path:
        """One of these instances, with the hosts that there are; `of_hosts` are further settings of those.

        If it is not called `Lab`, its hosts are only those that its instances name.
        """
        hosts = {name: host for name, host in self.hosts.items() if called == "Lab" or f"host {name};" in instances}
        blocks = "".join(
            f'host {name} {{ address "{host.address}"; user "root"; python "{sys.executable}"; '
            f"{of_hosts.get(name, '')} }};\n"
            for name, host in hosts.items()
        )
        path = self.folder / ("net.ddsl" if called == "Lab" else f"{called}.ddsl")
        models = sorted(self._components.glob("*/*.cdsl"))
        imports = "".join(f'import "{model}";\n' for model in models)
        path.write_text(f"{imports}Deployment {called} {{\n{said or 'security open;'}\n{blocks}{instances}\n}};\n")
        return path

    def rc(self, *arguments: object) -> Rcdeploy:
        """Run `rc` to its end."""
        return self._ended("-m", "robocomp_py.cli.rc", *map(str, arguments))

    def script(self, code: str) -> Rcdeploy:
        """Run a script of the user to its end."""
        return self._ended("-c", code)

    def _ended(self, *words: str) -> Rcdeploy:
        self.runs.append(Rcdeploy(self._environment, self.folder, *words))
        self.runs[-1].wait(LONG)
        return self.runs[-1]

    def beginning(self, *arguments: object) -> Rcdeploy:
        """Let `rc` run on."""
        words = ("-m", "robocomp_py.cli.rc", *map(str, arguments))
        self.runs.append(Rcdeploy(self._environment, self.folder, *words))
        return self.runs[-1]

    def run(self, *arguments: object) -> Rcdeploy:
        words = ("-m", "robocomp_py.cli.rcdeploy", *map(str, arguments))
        self.runs.append(Rcdeploy(self._environment, self.folder, *words))
        return self.runs[-1]

    def close(self) -> None:
        """End what a test that failed has left."""
        for run in self.runs:
            run.kill()

    def done(self, *arguments: object) -> Rcdeploy:
        """Run to its end."""
        running = self.run(*arguments)
        running.wait(LONG)
        return running

    def echoes(self, name: str) -> set[int]:
        """The processes of components called so on a host."""
        found = set()
        for pid in self.hosts[name].pids():
            with contextlib.suppress(OSError):
                if "--name\0echo" in Path(f"/proc/{pid}/cmdline").read_text():
                    found.add(pid)
        return found

    def left(self, name: str) -> list[str]:
        """What runs on a host, but for its SSH server."""
        found = []
        for pid in self.hosts[name].pids():
            try:
                words = Path(f"/proc/{pid}/cmdline").read_text().replace("\0", " ").strip()
            except OSError:
                continue
            if words and not words.startswith(("sshd", "/usr/sbin/sshd")):
                found.append(words)
        return found


class Rcdeploy:
    """`rcdeploy`, or another program in Python, and what it has said so far."""

    def __init__(self, environment: dict[str, str], folder: Path, *words: str) -> None:
        pipe = subprocess.PIPE
        self._process = subprocess.Popen(
            [sys.executable, *words],
            env=environment,
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=pipe,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self.lines: list[str] = []
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    @property
    def text(self) -> str:
        return "\n".join(self.lines)

    def says(self, pattern: str, times: int = 1) -> None:
        def found() -> bool:
            if self._process.poll() is not None and not self._reader.is_alive():
                assert len(re.findall(pattern, self.text)) >= times, f"{pattern!r} in\n{self.text}"
            return len(re.findall(pattern, self.text)) >= times

        wait_until(found, LONG, f"{pattern!r}")

    def signal(self, number: signal.Signals) -> None:
        self._process.send_signal(number)

    def interrupt(self) -> None:
        """As Ctrl-C does, if it runs."""
        if self._process.poll() is None:
            self.signal(signal.SIGINT)

    def kill(self) -> None:
        if self._process.poll() is None:
            self._process.kill()
        self._process.wait()
        self._reader.join(SOON)

    def wait(self, seconds: float = LONG) -> int:
        try:
            code = self._process.wait(seconds)
        except subprocess.TimeoutExpired:
            self._process.kill()
            raise AssertionError(f"it goes on\n{self.text}") from None
        finally:
            self._reader.join(SOON)
        return code

    @property
    def code(self) -> int:
        return self.wait()

    def _read(self) -> None:
        assert self._process.stdout
        with self._process.stdout as output:
            for line in output:
                self.lines.append(line.rstrip("\n"))


def gone(site: Site, *names: str) -> None:
    def left() -> list[str]:
        return [words for name in names for words in site.left(name)]

    try:
        wait_until(lambda: not left(), LONG)
    except AssertionError:
        said = "\n".join(run.text for run in site.runs)
        raise AssertionError(f"left after {LONG:g} s: {left()}\n{said}") from None
