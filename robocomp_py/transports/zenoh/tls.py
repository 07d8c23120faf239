"""Reads the folder `keys`, made by `rcdeploy keys`: a component's identity for routers that require certificates."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from ...errors import ConfigurationError
from ..keyfiles import Rights, rights_to_use
from ..private import insist_private

_FILES = "ca.pem", "certificate.pem", "key.pem", "identity.json"

NUMBER_BITS = 16
"""The leading bits of a transport's id that hold its process's number; the router's rules identify links by it."""


def checked(keys: str) -> Path | None:
    """The folder of keys, with all files checked; None if `keys` is empty. Raises ConfigurationError."""
    if not keys:
        return None
    folder = Path(keys)
    for name in _FILES:
        try:
            (folder / name).stat()
            if name == "key.pem":
                insist_private(folder / name, "zenoh: `keys`")
        except OSError as exc:
            raise ConfigurationError(
                f"zenoh: `keys`: {folder / name}: {exc.strerror}; make the keys again: rcdeploy keys"
            ) from exc
    return folder


def number(folder: Path) -> int:
    """The number of the process in the network. Raises ConfigurationError."""
    path = folder / "identity.json"
    try:
        told = json.loads(path.read_text(encoding="utf-8"))
        found = told["number"]
    except (OSError, ValueError, KeyError, TypeError) as exc:
        raise ConfigurationError(f"zenoh: `keys`: {path} cannot be read: {exc!r}") from exc
    if type(found) is not int or not 0 <= found < 1 << NUMBER_BITS:
        raise ConfigurationError(f"zenoh: `keys`: {path}: `number` is {found!r}")
    return found


def rights(folder: Path) -> Rights:
    """What the process may use. The router enforces the same rules, but drops messages silently."""
    return rights_to_use(folder / "peers")


def client_settings(folder: Path | None) -> dict[str, Any]:
    """The TLS settings of a client's session; none without keys."""
    if folder is None:
        return {}
    return {
        f"transport/link/tls/{key}": value
        for key, value in {
            "root_ca_certificate": str(folder / "ca.pem"),
            "connect_certificate": str(folder / "certificate.pem"),
            "connect_private_key": str(folder / "key.pem"),
            "enable_mtls": True,
            "verify_name_on_connect": True,
        }.items()
    }
