"""Finds out why a router refuses us. Zenoh only reports a time-out, so this tries a TLS handshake itself.

It is called only after an attempt to connect has failed.
"""

from __future__ import annotations

import re
import socket
import ssl
from pathlib import Path

_ENDPOINT = re.compile(r"(tcp|tls)/(?:\[([^\]]+)\]|([^:\[\]]+)):(\d+)(?:[?#].*)?\Z")

_TIMEOUT = 1.0
"""Seconds for each step of one attempt."""

_ALERTS = {
    "CERTIFICATE_REQUIRED": "it asks for a certificate, and this process has none; start it with --keys FOLDER",
    "HANDSHAKE_FAILURE": "it asks for a certificate, and this process has none; start it with --keys FOLDER",
    "CERTIFICATE_EXPIRED": "the certificate of this process has expired; run: rcdeploy keys NET.ddsl --renew",
    "UNKNOWN_CA": "it trusts another authority than the one that signed our certificate",
    "DECRYPT_ERROR": "it trusts another authority than the one that signed our certificate",
    "BAD_CERTIFICATE": "it does not accept our certificate",
    "CERTIFICATE_UNKNOWN": "it does not accept our certificate",
    "ACCESS_DENIED": "it does not accept our certificate",
}
"""Reasons, by the end of OpenSSL's name for the router's alert."""


def why_refused(endpoint: str, keys: Path | None) -> str:
    """The reason why the router at an endpoint refuses us; "" if it does not, or if no router answers."""
    found = _ENDPOINT.match(endpoint)
    if not found:
        return ""
    kind, host, port = found[1], found[2] or found[3], int(found[4])
    try:
        with socket.create_connection((host, port), _TIMEOUT) as connection:
            return _without_tls(connection) if kind == "tcp" else _with_tls(connection, host, keys)
    except OSError:
        return ""


def _without_tls(connection: socket.socket) -> str:
    """For a component without TLS. A router without TLS does not answer a handshake with an alert."""
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
            secured.recv(1)  # with TLS 1.3 the router checks our certificate after our side of the handshake
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
