"""CURVE: encryption, and who may talk to us, for sockets that others than our own user can reach.

    curve_key         file of our own key pair, as `zmq.auth.create_certificates` writes it (`NAME.key_secret`); 0600
    curve_admitted    folder with the public keys (`*.key`) of those who may talk to us

Sockets in files need none: the run-time folder is open to its user alone. Whoever connects is asked for by ZeroMQ at
`ZAP`, an address within the process; the folder is read each time, so a key that is removed admits nobody any more.
"""

from __future__ import annotations

import contextlib
import stat
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import zmq
from zmq.utils import z85

from ...errors import ConfigurationError

Secure = Callable[["zmq.Socket[Any]"], object]
"""Prepares a socket, before it is bound or connected."""

ZAP = "inproc://zeromq.zap.01"

_DOMAIN = b"robocomp"

_REASONS = {
    zmq.EVENT_HANDSHAKE_FAILED_AUTH: "its key is not admitted",
    zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL: "it does not use CURVE, or has a wrong key of ours",
    zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL: "it did not finish the handshake; perhaps it does not use CURVE",
}
"""Why somebody is not let in, by the event that a socket's monitor tells."""


@dataclass(frozen=True)
class Curve:
    """Our key pair, and where the keys of others are."""

    public: bytes
    secret: bytes = field(repr=False)
    admitted: Path

    def serve(self, socket: zmq.Socket[Any]) -> None:
        """Let in whom we admit."""
        socket.setsockopt(zmq.CURVE_SERVER, 1)
        socket.setsockopt(zmq.CURVE_SECRETKEY, self.secret)
        socket.setsockopt(zmq.ZAP_DOMAIN, _DOMAIN)

    def ask(self, server: bytes) -> Secure:
        """For sockets that connect to one who has that public key."""

        def secure(socket: zmq.Socket[Any]) -> None:
            socket.setsockopt(zmq.CURVE_SERVERKEY, server)
            socket.setsockopt(zmq.CURVE_PUBLICKEY, self.public)
            socket.setsockopt(zmq.CURVE_SECRETKEY, self.secret)

        return secure

    def admits(self, public: bytes) -> bool:
        keys = []
        with contextlib.suppress(OSError):  # gone since we started: then nobody is
            keys = [path for path in self.admitted.iterdir() if path.suffix == ".key"]
        return any(public_key(path) == public for path in keys)

    def judge(self, frames: list[Any]) -> list[bytes]:
        """The answer to a question of ZeroMQ's whether to let somebody in (RFC 27)."""
        version, request, domain, _, _, mechanism, *credentials = map(bytes, frames)
        known = mechanism == b"CURVE" and domain == _DOMAIN and len(credentials) == 1
        if known and self.admits(z85.encode(credentials[0])):
            return [version, request, b"200", b"OK", z85.encode(credentials[0]), b""]
        return [version, request, b"400", b"not admitted", b"", b""]


def configured(options: Mapping[str, Any]) -> Curve | None:
    """What `curve_key` and `curve_admitted` say; raises ConfigurationError."""
    key, admitted = str(options["curve_key"]), str(options["curve_admitted"])
    if not key and not admitted:
        return None
    if not key or not admitted:
        raise ConfigurationError(
            "`curve_key` and `curve_admitted` go together: our own key, and the folder with those of who may talk to us"
        )
    if not Path(admitted).is_dir():
        raise ConfigurationError(f"`curve_admitted`: {admitted} is not a folder")
    public, secret = key_pair(Path(key))
    return Curve(public, secret, Path(admitted))


def key_pair(path: Path) -> tuple[bytes, bytes]:
    """A public and a secret key from a file of its owner's alone; raises ConfigurationError."""
    try:
        mode = path.stat().st_mode
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as exc:
        raise ConfigurationError(f"`curve_key`: {path} cannot be read: {exc}") from exc
    if stat.S_IMODE(mode) & 0o077:
        raise ConfigurationError(f"`curve_key`: {path} is open to other users; chmod 600 {path}")
    public, secret = _value(text, "public-key"), _value(text, "secret-key")
    if not public or not secret:
        raise ConfigurationError(
            f"`curve_key`: {path} has no key pair; zmq.auth.create_certificates(FOLDER, NAME) makes NAME.key_secret"
        )
    return public, secret


def public_key(path: Path) -> bytes:
    """The public key in a file; empty if there is none."""
    try:
        return _value(path.read_text(encoding="utf-8"), "public-key")
    except (OSError, UnicodeDecodeError):
        return b""


def why_not(event: list[Any]) -> str:
    """Why somebody was not let in, as a socket's monitor tells it."""
    number, _ = struct.unpack("=hi", event[0])
    return _REASONS.get(number, f"event {number}")


WATCHED = int(sum(int(event) for event in _REASONS))
"""The events that a monitor is to tell."""


def _value(text: str, name: str) -> bytes:
    """From lines like `public-key = "…"`: forty characters of Z85, as ZeroMQ takes them."""
    for line in text.splitlines():
        key, _, value = line.strip().partition("=")
        if key.strip() == name:
            found = value.strip().strip('"').encode(errors="replace")
            return found if len(found) == 40 else b""
    return b""
