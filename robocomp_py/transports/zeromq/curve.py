"""CURVE: encryption and access rights for sockets that other users can reach.

    curve_key         file of our own key pair, as `zmq.auth.create_certificates` writes it (`NAME.key_secret`);
                      mode 0600, or 0640 if it is root's
    curve_admitted    folder with the public keys (`*.key`) of admitted clients
    curve_peers       folder with the public keys (`NAME.key`) of the servers in `connect`
    keys              a folder with all of them: `curve.key_secret`, `admitted`, `peers`; `rcdeploy keys` makes it

The file of a public key may restrict, in a line `channels = "A B"`, the channels that its owner may use or offer;
without that line, it may use all. `ipc://` sockets need no keys: the run-time folder is open to its user alone. For
each connection, ZeroMQ asks at `ZAP`, an address within the process. The folder is read each time, so a removed key
loses its access at once.
"""

from __future__ import annotations

import contextlib
import logging
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import zmq
from zmq.utils import z85

from ...errors import ConfigurationError
from ..keyfiles import Rights, key_in, read_public
from ..private import read_private

log = logging.getLogger("robocomp.transport.zeromq")

Secure = Callable[["zmq.Socket[Any]"], object]
"""Prepares a socket, before it is bound or connected."""

ZAP = "inproc://zeromq.zap.01"

_DOMAIN = b"robocomp"
"""The domain of sockets for several channels. For a single channel, the domain is its name."""

_LONGEST_DOMAIN = 255
"""Octets; ZeroMQ's limit."""

_REASONS = {
    zmq.EVENT_HANDSHAKE_FAILED_AUTH: "its key is not admitted",
    zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL: "it does not use CURVE, or has a wrong key of ours",
    zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL: "it did not finish the handshake; perhaps it does not use CURVE",
}
"""Why a client is not admitted, by the event of a socket's monitor."""


@dataclass(frozen=True)
class Curve:
    """The own key pair, and the folders with the keys of others."""

    public: bytes
    secret: bytes = field(repr=False)
    admitted: Path | None = None
    peers: Path | None = None

    def serve(self, socket: zmq.Socket[Any], channel: str = "") -> None:
        """Admit clients with a known key; for one channel, only those that may use it. Raises ConfigurationError."""
        domain = channel.encode() or _DOMAIN
        if len(domain) > _LONGEST_DOMAIN:
            raise ConfigurationError(
                f"zeromq: the name of a topic that keys protect may have {_LONGEST_DOMAIN} octets, and {channel} has "
                f"{len(domain)}; choose a shorter name of the instance"
            )
        socket.setsockopt(zmq.CURVE_SERVER, 1)
        socket.setsockopt(zmq.CURVE_SECRETKEY, self.secret)
        socket.setsockopt(zmq.ZAP_DOMAIN, domain)

    def ask(self, server: bytes) -> Secure:
        """Secure sockets that connect to the owner of that public key."""

        def secure(socket: zmq.Socket[Any]) -> None:
            socket.setsockopt(zmq.CURVE_SERVERKEY, server)
            socket.setsockopt(zmq.CURVE_PUBLICKEY, self.public)
            socket.setsockopt(zmq.CURVE_SECRETKEY, self.secret)

        return secure

    def rights(self, public: bytes) -> Rights | None:
        """The rights of the owner of that key; None if it is not admitted."""
        paths: list[Path] = []
        if self.admitted:
            with contextlib.suppress(OSError):  # removed since the start: no key is admitted
                paths = [path for path in self.admitted.iterdir() if path.suffix == ".key"]
        for path in paths:
            key, rights = read_public(path)
            if key == public:
                return rights
        return None

    def peer(self, name: str) -> tuple[bytes, Rights]:
        """The public key of a server, and its rights. Raises ConfigurationError."""
        path = (self.peers or Path()) / f"{name.replace('/', '.')}.key"
        key, rights = read_public(path) if self.peers else (b"", Rights())
        if not key:
            raise ConfigurationError(f"zeromq: no public key of `{name}` in {path}; make keys again: rcdeploy keys")
        return key, rights


class Gate:
    """Decides for ZeroMQ which clients to admit (RFC 27), and remembers them."""

    def __init__(self, curve: Curve) -> None:
        self._curve = curve
        self._inside: dict[str, Rights] = {}
        """By public key, which is what ZeroMQ calls the user of a message."""

    def judge(self, frames: list[Any]) -> list[bytes]:
        version, request, domain, _, _, mechanism, *credentials = map(bytes, frames)
        if mechanism == b"CURVE" and len(credentials) == 1:
            public = z85.encode(credentials[0])
            rights = self._curve.rights(public)
            if rights and (domain == _DOMAIN or rights.allow(domain.decode(errors="replace"))):
                self._inside[public.decode()] = rights
                return [version, request, b"200", b"OK", public, b""]
            self._inside.pop(public.decode(), None)
        return [version, request, b"400", b"not admitted", b"", b""]

    def rights(self, user: str) -> Rights:
        """The rights of an admitted client."""
        return self._inside.get(user, _NONE)


_NONE = Rights(frozenset())


def configured(options: Mapping[str, Any]) -> Curve | None:
    """What the options say; raises ConfigurationError."""
    if keys := str(options["keys"]):
        folder = Path(keys)
        if not folder.is_dir():
            raise ConfigurationError(f"zeromq: `keys`: {folder} is not a folder; rcdeploy keys makes it")
        return Curve(*key_pair(folder / "curve.key_secret"), folder / "admitted", folder / "peers")
    key, admitted, peers = (str(options[name]) for name in ("curve_key", "curve_admitted", "curve_peers"))
    if not key and not admitted and not peers:
        return None
    if not key or not (admitted or peers):
        raise ConfigurationError(
            "`curve_key` and `curve_admitted` go together: the own key, and the folder with keys of admitted clients"
            " (or `curve_peers`, with the keys of servers)"
        )
    for name, given in (("curve_admitted", admitted), ("curve_peers", peers)):
        if given and not Path(given).is_dir():
            raise ConfigurationError(f"`{name}`: {given} is not a folder")
    public, secret = key_pair(Path(key))
    return Curve(public, secret, Path(admitted) if admitted else None, Path(peers) if peers else None)


def key_pair(path: Path) -> tuple[bytes, bytes]:
    """A public and a secret key from a file that no other user may read; raises ConfigurationError."""
    try:
        text = read_private(path, "`curve_key`")
    except (OSError, UnicodeDecodeError) as exc:
        raise ConfigurationError(f"`curve_key`: {path} cannot be read: {exc}") from exc
    public, secret = key_in(text, "public-key"), key_in(text, "secret-key")
    if not public or not secret:
        raise ConfigurationError(
            f"`curve_key`: {path} has no key pair; zmq.auth.create_certificates(FOLDER, NAME) makes NAME.key_secret"
        )
    return public, secret


def why_not(event: list[Any]) -> str:
    """Why a client was not admitted, by an event of a socket's monitor."""
    number, _ = struct.unpack("=hi", event[0])
    return _REASONS.get(number, f"event {number}")


WATCHED = int(sum(int(event) for event in _REASONS))
"""The events that a monitor has to report."""
