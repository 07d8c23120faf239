"""The known keys of hosts: those of the user's SSH, and those of `rcdeploy trust`.

    $XDG_CONFIG_HOME/robocomp/known_hosts    ours, as OpenSSH writes such files; 0600
    ~/.ssh/known_hosts                       the user's

For a host in our file, the user's file is ignored.
"""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import asyncssh

from ...errors import DeploymentError
from ..plan import Host


@dataclass(frozen=True)
class Presented:
    """The key that a host has presented."""

    host: str
    port: int
    key: str
    """Algorithm and key, as files have them."""
    fingerprint: str
    known: tuple[str, ...] = ()
    """Fingerprints of its known keys."""


def host_of(target: str) -> Host:
    """`[USER@]ADDRESS[:PORT]`; an IPv6 address with a port is in brackets. Raises DeploymentError."""
    user, _, rest = target.rpartition("@")
    found = re.fullmatch(r"\[([^\]]+)\](?::(\d+))?|([^:\s]+):(\d+)|([^\[\]\s]+)", rest)
    port = int((found[2] or found[4] or 0) if found else 0)
    if not found or rest.startswith("-") or port > 65535:
        raise DeploymentError(f"`{target}` is not a host; write [USER@]ADDRESS[:PORT]")
    address = found[1] or found[3] or found[5]
    return Host(address, address, user, port)


def own_file() -> Path:
    base = os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config"
    return Path(base, "robocomp", "known_hosts")


def user_file() -> Path:
    return Path.home() / ".ssh" / "known_hosts"


def known_keys(host: str, address: str, port: int | None) -> Any:
    """The known keys, authorities and revoked keys of a host, as asyncssh's tuple."""
    for path in (own_file(), user_file()):
        found = _read(path).match(host, address, port if port != asyncssh.DEFAULT_PORT else None)
        if any(found):
            return found
    return asyncssh.import_known_hosts("").match(host, address, port)


def remember(presented: Presented) -> Path:
    """Make this the only known key of a host. Returns the file that has it. Raises DeploymentError."""
    path = own_file()
    name = presented.host if presented.port == asyncssh.DEFAULT_PORT else f"[{presented.host}]:{presented.port}"
    try:
        lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
        kept = [line for line in lines if line.split(" ", 1)[0] != name]
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        draft = path.with_suffix(".draft")
        draft.touch(mode=0o600)
        draft.write_text("".join(f"{line}\n" for line in (*kept, f"{name} {presented.key}")), encoding="utf-8")
        draft.replace(path)
    except (OSError, UnicodeError) as exc:
        raise DeploymentError(f"{path} cannot be written: {exc}") from exc
    return path


def _read(path: Path) -> asyncssh.SSHKnownHosts:
    try:
        return asyncssh.import_known_hosts(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return asyncssh.import_known_hosts("")
    except (OSError, ValueError) as exc:
        raise DeploymentError(f"{path} cannot be read: {exc}") from exc
