"""Why a router turns us away. Zenoh only reports a time-out, so this tries TLS itself.

Nothing here is in the path of a message: it is called after an attempt to connect has failed.
"""

from __future__ import annotations

import re
import socket
import ssl
from pathlib import Path

_ENDPOINT = re.compile(r"(tcp|tls)/(?:\[([^\]]+)\]|([^:\[\]]+)):(\d+)(?:[?#].*)?\Z")

_PATIENCE = 1.0
"""Seconds for each step of one attempt."""

_ALERTS = {
    "CERTIFICATE_REQUIRED": "it asks for a certificate, and this process has none; start it with --keys FOLDER",
    "HANDSHAKE_FAILURE": "it asks for a certificate, and this process has none; start it with --keys FOLDER",
    "CERTIFICATE_EXPIRED": "the certificate of this process has expired; run: rcdeploy keys NET.ddsl --renew",
    "UNKNOWN_CA": "it knows another authority than the one that signed our certificate",
    "DECRYPT_ERROR": "it knows another authority than the one that signed our certificate",
    "BAD_CERTIFICATE": "it does not accept our certificate",
    "CERTIFICATE_UNKNOWN": "it does not accept our certificate",
    "ACCESS_DENIED": "it does not accept our certificate",
}
"""By the end of what OpenSSL calls the router's alert."""


def why_refused(endpoint: str, keys: Path | None) -> str:
    """Why the router at an endpoint of Zenoh's does not let us in; "" if it does, or if no router answers."""
    found = _ENDPOINT.match(endpoint)
    if not found:
        return ""
    kind, host, port = found[1], found[2] or found[3], int(found[4])
    try:
        with socket.create_connection((host, port), _PATIENCE) as connection:
            return _without_tls(connection) if kind == "tcp" else _with_tls(connection, host, keys)
    except OSError:
        return ""


def _without_tls(connection: socket.socket) -> str:
    """For a component that would speak plainly. Whatever else answers to TLS is no router without it."""
    context = _context(None)
    try:
        with context.wrap_socket(connection):
            pass
    except ssl.SSLError as exc:
        if "ALERT" not in (exc.reason or ""):
            return ""
    return "it speaks TLS only; connect to tls/ADDRESS:PORT, and start this process with --keys FOLDER"


def _with_tls(connection: socket.socket, host: str, keys: Path | None) -> str:
    context = _context(keys)
    try:
        with context.wrap_socket(connection, server_hostname=host) as secured:
            secured.recv(1)  # with TLS 1.3 the router looks at our certificate after our side of the handshake is over
    except ssl.SSLCertVerificationError as exc:
        return f"it is not the router of this network: {exc.verify_message}"
    except ssl.SSLError as exc:
        alert = (exc.reason or "").rpartition("ALERT_")[2]
        return _ALERTS.get(alert, "")
    return ""


def _context(keys: Path | None) -> ssl.SSLContext:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    if keys is None:
        context.check_hostname = False
        context.verify_mode = ssl.CERT_NONE
        return context
    context.load_verify_locations(keys / "ca.pem")
    context.load_cert_chain(keys / "certificate.pem", keys / "key.pem")
    return context
