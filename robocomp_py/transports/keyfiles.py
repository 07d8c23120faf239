"""Files with the public key of another process, and the channels that it is for, as `rcdeploy keys` makes them.

Every transport with keys reads them: the rights of a process are the same over all of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ..wire.names import matches


@dataclass(frozen=True)
class Rights:
    """What the owner of a key may use of ours, or offer to us."""

    channels: frozenset[str] | None = None
    """None: everything."""

    def allow(self, channel: str) -> bool:
        """Whether a channel is among them; it may have `*` for its instance."""
        if self.channels is None or channel in self.channels:
            return True
        return any(matches(channel, each) for each in self.channels)


def read_public(path: Path) -> tuple[bytes, Rights]:
    """The public key in a file, and what it allows; an empty key if there is none."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return b"", Rights()
    channels = _value(text, "channels")
    return key_in(text, "public-key"), Rights() if channels is None else Rights(frozenset(channels.split()))


def rights_to_use(folder: Path) -> Rights:
    """What a process may use of all others, by the files of its peers; everything if there is no such folder."""
    if not folder.is_dir():
        return Rights()
    channels: set[str] = set()
    for path in folder.glob("*.key"):
        _, rights = read_public(path)
        if rights.channels is None:
            return Rights()
        channels |= rights.channels
    return Rights(frozenset(channels))


def key_in(text: str, name: str) -> bytes:
    """Forty characters of Z85, as ZeroMQ takes them."""
    found = (_value(text, name) or "").encode(errors="replace")
    return found if len(found) == 40 else b""


def _value(text: str, name: str) -> str | None:
    """From lines like `public-key = "…"`."""
    for line in text.splitlines():
        key, equals, value = line.strip().partition("=")
        if equals and key.strip() == name:
            return value.strip().strip('"')
    return None
