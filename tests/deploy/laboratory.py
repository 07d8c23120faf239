"""Hosts on one machine: network namespaces on a bridge, with faults on the way, and SSH servers in them.

    with Laboratory() as laboratory:
        onboard = laboratory.host("onboard")
        server = onboard.run(["python3", "server.py"])
        onboard.partition()
        onboard.heal()

This machine is on the bridge, too, at `laboratory.address`. What is lost is lost where it comes in: on the way out the
sender's kernel would know, and try again sooner than with a real cable. Needs root, iproute2 and openssh-server. Names
carry the number of our process: what a killed one left is removed by the next `Laboratory`.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import re
import shutil
import signal
import socket
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

from robocomp_py.testing.patience import wait_until

_SUBNETS = itertools.count(64 * os.getpid())
"""So many for each process of tests: another one that was started just after it makes its own."""

_LATE = 60.0
"""Seconds after which a command of a host counts as hanging."""


def _do(*command: str, check: bool = True) -> str:
    done = subprocess.run(command, capture_output=True, text=True, timeout=_LATE)
    if check and done.returncode:
        raise RuntimeError(f"{' '.join(command)}: {done.stderr.strip() or done.stdout.strip()}")
    return done.stdout


def subnet(number: int) -> str:
    """How the addresses of a subnet begin."""
    return f"10.{200 + number // 250 % 50}.{number % 250}"


def unused(addresses: str) -> int:
    """The number of a subnet in which this machine has none of its addresses, as `ip address` tells them.

    Numbers begin anew after 12,500, so another process may have the same ones, and the network of the machine, too.
    """
    there = set(re.findall(r"inet (\d+\.\d+\.\d+)\.", addresses))
    return next(number for number in _SUBNETS if subnet(number) not in there)


class Laboratory:
    """A bridge, and hosts on it, which end with it: what runs there is killed."""

    def __init__(self) -> None:
        _sweep()
        number = unused(_do("ip", "-4", "-o", "address"))
        self._name = f"rc{os.getpid()}"
        self._subnet = subnet(number)
        self._bridge = f"{self._name}b{number % 1000}"
        self.address = f"{self._subnet}.1"
        self.hosts: list[Host] = []
        _do("ip", "link", "add", self._bridge, "type", "bridge")
        try:
            # Without this a packet to the bridge itself may wait until it knows all addresses.
            _do("ip", "link", "set", self._bridge, "type", "bridge", "forward_delay", "0", check=False)
            _do("ip", "address", "add", f"{self.address}/24", "dev", self._bridge)
            _do("ip", "link", "set", self._bridge, "up")
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def host(self, name: str) -> Host:
        """A new one, which reaches this machine and all the others."""
        number = len(self.hosts) + 10
        host = Host(
            name, f"{self._subnet}.{number}", f"{self._bridge}h{number}"[-15:], f"{self._name}h{number}", self._bridge
        )
        self.hosts.append(host)
        host.begin()
        return host

    def close(self) -> None:
        """Idempotent."""
        for host in self.hosts:
            host.die()
        _do("ip", "link", "delete", self._bridge, check=False)

    def left(self) -> list[str]:
        """What there is of us: namespaces and network interfaces."""
        return _there(os.getpid())


@dataclass
class Host:
    """A namespace. Processes in it share everything but the network with this machine."""

    name: str
    address: str
    _device: str
    """Our end of its cable."""
    _space: str
    _bridge: str
    dead: bool = False
    _started: list[subprocess.Popen[Any]] = field(default_factory=list)

    def begin(self) -> None:
        _do("ip", "netns", "add", self._space)
        _do("ip", "link", "add", self._device, "type", "veth", "peer", "name", "eth0", "netns", self._space)
        _do("ip", "link", "set", self._device, "master", self._bridge, "up")
        self.do("ip", "link", "set", "lo", "up")
        self.do("ip", "address", "add", f"{self.address}/24", "dev", "eth0")
        self.do("ip", "link", "set", "eth0", "up")

    # What runs there.

    def command(self, *words: str) -> list[str]:
        """What runs a command there."""
        return ["ip", "netns", "exec", self._space, *words]

    def do(self, *words: str) -> str:
        """Run a command there, to its end; its output."""
        return _do(*self.command(*words))

    def run(self, words: Sequence[str], **options: Any) -> subprocess.Popen[Any]:
        """Start a command there; `options` are those of Popen."""
        started = subprocess.Popen(self.command(*words), **options)
        self._started.append(started)
        return started

    def pids(self) -> list[int]:
        """All that runs there."""
        return [int(pid) for pid in _do("ip", "netns", "pids", self._space, check=False).split()]

    # Faults.

    def lose(self, percent: float) -> None:
        """Have so many packets in a hundred lost, both ways."""
        self.heal()
        keep = min(2**32 - 1, int((100 - percent) * 2**32 / 100))
        program = f"4,32 0 0 4294963256,37 0 1 {keep},6 0 0 2,6 0 0 4294967295"  # a random number; more than that: drop
        for command in (self.command("tc"), ["tc"]):
            device = "eth0" if len(command) > 1 else self._device
            _do(*command, "qdisc", "add", "dev", device, "clsact")
            _do(*command, "filter", "add", "dev", device, "ingress", "bpf", "da", "bytecode", program)

    def partition(self) -> None:
        """Cut its cable. Nobody is told."""
        self.lose(100)

    def heal(self) -> None:
        """No packets are lost any more."""
        for command in (self.command("tc"), ["tc"]):
            device = "eth0" if len(command) > 1 else self._device
            _do(*command, "qdisc", "delete", "dev", device, "clsact", check=False)

    def die(self) -> None:
        """Cut its cable, kill all that runs there, and remove it. Idempotent."""
        if self.dead:
            return
        self.dead = True
        _do("ip", "link", "delete", self._device, check=False)
        while pids := self.pids():
            for pid in pids:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
            wait_until(lambda pids=pids: not any(map(_runs, pids)))
        for started in self._started:
            started.wait(_LATE)
        _do("ip", "netns", "delete", self._space, check=False)


class SshServer:
    """OpenSSH's own, in a host, for root by a key that is made for it.

    Whoever logs in has a home and a run-time folder below `folder`, so that hosts do not share them.
    """

    def __init__(self, host: Host, folder: Path, key: Path, environment: Mapping[str, str] | None = None) -> None:
        self.host, self.folder, self.port = host, folder, 22
        self.home, self.runtime = folder / "home", folder / "run"
        for made in (self.home, self.runtime):
            made.mkdir(mode=0o700, parents=True, exist_ok=True)
        self._host_key = folder / "host_key"
        make_key(self._host_key)
        authorized = folder / "authorized_keys"
        authorized.write_text(key.with_suffix(".pub").read_text())
        Path("/run/sshd").mkdir(mode=0o755, exist_ok=True)
        variables = {
            "HOME": str(self.home),
            "ROBOCOMP_RUNTIME_DIR": str(self.runtime),
            **(environment or {}),
        }
        self._configuration = folder / "sshd_config"
        self._configuration.write_text(
            "\n".join(
                (
                    f"ListenAddress {host.address}:{self.port}",
                    f"HostKey {self._host_key}",
                    f"AuthorizedKeysFile {authorized}",
                    "StrictModes no",
                    "UsePAM no",
                    "PermitRootLogin prohibit-password",
                    "PasswordAuthentication no",
                    "KbdInteractiveAuthentication no",
                    "PidFile none",
                    "MaxSessions 1",
                    f"SetEnv {' '.join(f'{name}={value}' for name, value in variables.items())}",
                    "",
                )
            )
        )
        self._running: subprocess.Popen[bytes] | None = None
        self.start()

    @property
    def public_key(self) -> str:
        """As it stands in a file of known hosts, without the host."""
        return " ".join(self._host_key.with_suffix(".pub").read_text().split()[:2])

    def change_key(self) -> None:
        """As if another machine had its address now."""
        self.stop()
        make_key(self._host_key)
        self.start()

    def start(self) -> None:
        sshd = shutil.which("sshd", path="/usr/sbin:/usr/local/sbin:/sbin") or "sshd"
        log = (self.folder / "sshd.log").open("ab")
        with log:
            words = [sshd, "-D", "-e", "-f", str(self._configuration)]
            self._running = self.host.run(words, stdin=subprocess.DEVNULL, stdout=log, stderr=log)
        wait_until(self._answers)

    def stop(self) -> None:
        """No new connections; those that are there stay."""
        if self._running:
            self._running.terminate()
            self._running.wait(_LATE)
            self._running = None

    def _answers(self) -> bool:
        assert self._running
        if self._running.poll() is not None:
            raise RuntimeError((self.folder / "sshd.log").read_text())
        with contextlib.suppress(OSError), socket.create_connection((self.host.address, self.port), timeout=1):
            return True
        return False


def make_key(path: Path) -> None:
    """A key pair for SSH; what was there is written over."""
    for old in (path, path.with_suffix(".pub")):
        old.unlink(missing_ok=True)
    _do("ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-C", "laboratory", "-f", str(path))


def _runs(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"


def _there(pid: int) -> list[str]:
    """Namespaces and network interfaces that are called after a process."""
    spaces = [line.split()[0] for line in _do("ip", "netns", "list").splitlines() if line.strip()]
    devices = [line.split(":")[1].strip().split("@")[0] for line in _do("ip", "-o", "link").splitlines()]
    return [name for name in (*spaces, *devices) if re.match(rf"rc{pid}\D", name)]


def _sweep() -> None:
    """Remove what processes left that are gone."""
    spaces = [line.split()[0] for line in _do("ip", "netns", "list").splitlines() if line.strip()]
    for space in spaces:
        if (found := re.match(r"rc(\d+)\D", space)) and not _runs(int(found[1])):
            Host("", "", "", space, "").die()
    for line in _do("ip", "-o", "link").splitlines():
        device = line.split(":")[1].strip().split("@")[0]
        if (found := re.match(r"rc(\d+)\D", device)) and not _runs(int(found[1])):
            _do("ip", "link", "delete", device, check=False)
