"""One connection and one channel to a host, with errors for users.

The user's own configuration of SSH applies (`~/.ssh/config`, keys, agent). There are no questions for a password, since
a network may be restarted while no user is present. No terminal, no forwarding of any kind.
"""

from __future__ import annotations

import asyncio
import contextlib
import shlex
import socket
from collections.abc import Sequence
from typing import Any

import asyncssh

from ...errors import HostUnreachable
from ..plan import Host
from .lines import shown
from .trusting import Presented, host_of, known_keys

CONNECT_TIMEOUT = 15.0
"""Seconds for a login."""


ENDING = 5.0
"""Seconds for a finished program to end."""


class Channel:
    """A program on a host, with its input and output."""

    def __init__(self, connection: asyncssh.SSHClientConnection, process: asyncssh.SSHClientProcess[bytes]) -> None:
        self._connection, self._process = connection, process
        self.reader, self.writer = process.stdout, process.stdin

    @property
    def exit_status(self) -> int | None:
        return self._process.returncode

    async def said(self) -> str:
        """The errors that the program or its shell printed, and how it ended."""
        try:
            async with asyncio.timeout(CONNECT_TIMEOUT):
                text = shown((await self._process.stderr.read(4000)).decode(errors="replace")).strip()
                await self._process.wait_closed()
        except (TimeoutError, OSError, asyncssh.Error):
            return ""
        if not text and self._process.returncode is not None:
            return f"it ended with exit status {self._process.returncode}"
        return text or "the connection was closed"

    async def close(self) -> None:
        """Wait briefly for the program to end, then close. Idempotent."""
        with contextlib.suppress(TimeoutError, OSError, asyncssh.Error):
            async with asyncio.timeout(ENDING):
                await self._process.wait_closed()
        self._process.close()
        self._connection.close()
        try:
            async with asyncio.timeout(CONNECT_TIMEOUT):
                await self._connection.wait_closed()
        except TimeoutError:
            self._connection.abort()

    def abort(self) -> None:
        """Drop the connection at once."""
        self._connection.abort()


async def run(host: Host, command: Sequence[str], **options: Any) -> Channel:
    """Start a program there. Raises HostUnreachable; `options` are further ones of asyncssh's."""
    connection = await connect(host, **options)
    try:
        line = f"exec {shlex.join(command)}"
        async with asyncio.timeout(CONNECT_TIMEOUT):
            process = await connection.create_process(line, encoding=None, request_pty=False)
    except BaseException as exc:  # also if this task is cancelled
        connection.abort()
        if isinstance(exc, TimeoutError):
            raise HostUnreachable(f"{called(host)}: it has not run a program within {CONNECT_TIMEOUT:g} s") from exc
        if isinstance(exc, OSError | asyncssh.Error):
            raise HostUnreachable(f"{called(host)}: it does not run programs: {_reason(exc)}") from exc
        raise
    return Channel(connection, process)


async def connect(host: Host, **options: Any) -> asyncssh.SSHClientConnection:
    """Log in. Raises HostUnreachable, with a hint."""
    asked: dict[str, Any] = {
        "known_hosts": known_keys,
        "agent_forwarding": False,
        "password_auth": False,
        "kbdint_auth": False,
        "connect_timeout": CONNECT_TIMEOUT,
        "login_timeout": CONNECT_TIMEOUT,
        "keepalive_interval": 5,
        "keepalive_count_max": 3,
    }
    asked |= {"username": host.user} if host.user else {}
    asked |= {"port": host.port} if host.port else {}
    watch = _KeyWatch()
    try:
        connection, _ = await asyncssh.create_connection(lambda: watch, host.address, **(asked | options))
    except asyncssh.HostKeyNotVerifiable as exc:
        raise HostUnreachable(_distrusted(host, watch.presented, str(exc))) from exc
    except asyncssh.PermissionDenied as exc:
        hint = f"`ssh {_target(host)} true` must work without a question: give it your key (ssh-copy-id), or load yours"
        raise HostUnreachable(f"{called(host)}: login failed: {_reason(exc)}; {hint} (ssh-add)") from exc
    except (OSError, asyncssh.Error, ValueError) as exc:
        hint = f"is it on, and does `ssh {_target(host)}` work?"
        raise HostUnreachable(f"{called(host)} cannot be reached: {_reason(exc)}; {hint}") from exc
    return connection


def presented(target: str) -> Presented:
    """The key that `[USER@]ADDRESS[:PORT]` shows. Raises HostUnreachable, DeploymentError."""
    return asyncio.run(key_of(host_of(target)))


async def key_of(host: Host, **options: Any) -> Presented:
    """The key that a host presents, unchecked and without a login. Raises HostUnreachable."""
    watch = _KeyWatch()
    asked: dict[str, Any] = {
        "known_hosts": _nothing_known,
        "connect_timeout": CONNECT_TIMEOUT,
        "login_timeout": CONNECT_TIMEOUT,
    }
    asked |= {"port": host.port} if host.port else {}
    try:
        connection, _ = await asyncssh.create_connection(lambda: watch, host.address, **(asked | options))
        connection.abort()
    except asyncssh.HostKeyNotVerifiable:
        pass
    except (OSError, asyncssh.Error, ValueError) as exc:
        raise HostUnreachable(f"{called(host)} cannot be reached: {_reason(exc)}; is it on?") from exc
    if watch.presented is None:
        raise HostUnreachable(
            f"{called(host)} has presented no plain key; a host certificate cannot be trusted this way"
        )
    return watch.presented


def called(host: Host) -> str:
    """A host's name and address, for messages."""
    return host.name if host.name == host.address else f"{host.name} ({host.address})"


class _KeyWatch(asyncssh.SSHClient):
    """Remembers a key that is not known."""

    presented: Presented | None = None

    def validate_host_public_key(self, host: str, addr: str, port: int, key: asyncssh.SSHKey) -> bool:
        text = " ".join(key.export_public_key("openssh").decode().split()[:2])
        keys = known_keys(host, addr, port)[0]
        self.presented = Presented(host, port, text, key.get_fingerprint(), tuple(k.get_fingerprint() for k in keys))
        return False


def _nothing_known(_host: str, _address: str, _port: int | None) -> Any:
    return [], [], [], [], [], [], []


def _distrusted(host: Host, presented: Presented | None, why: str) -> str:
    if presented is None:
        return f"{called(host)} is not the known host: {why}"
    trust = f"rcdeploy trust {_target(host, for_us=True)}"
    if presented.known:
        return (
            f"{called(host)} has the key {presented.fingerprint}, and the known one is "
            f"{' or '.join(presented.known)}; another machine may be intercepting the connection. "
            f"If the host was set up anew: {trust}"
        )
    return f"{called(host)} is not known; its key is {presented.fingerprint}. If that is right: {trust}"


def _target(host: Host, *, for_us: bool = False) -> str:
    """The host as an argument of ssh or `rcdeploy trust`."""
    named = f"{host.user}@{host.address}" if host.user else host.address
    if not host.port:
        return named
    return f"{named}:{host.port}" if for_us else f"-p {host.port} {named}"


def _reason(exc: Exception) -> str:
    if isinstance(exc, TimeoutError):
        return f"no answer in {CONNECT_TIMEOUT:g} s"
    if isinstance(exc, ConnectionRefusedError):  # asyncio's text is `Connect call failed`, with a tuple
        return "no SSH server answers at its port"
    if isinstance(exc, socket.gaierror):
        return "unknown host name; give its address"
    if isinstance(exc, OSError):
        return exc.strerror or str(exc) or type(exc).__name__
    return shown(getattr(exc, "reason", "") or str(exc)) or type(exc).__name__
