"""What was said in a simulation: its hash, and, if wanted, a line for each message."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from functools import lru_cache

from ..contract.types import Struct
from ..transports.base import Channel, Reply, Status
from ..wire.cdr import Cdr
from ..wire.codec import Decoder, Payload
from ..wire.readable import readable
from .executor import Executor

_CODEC = Cdr()


class Record:
    """Two runs that said the same at the same instants have the same hash."""

    def __init__(self, executor: Executor, write: Callable[[str], object] | None = None) -> None:
        """`write` gets each line, a JSON object with a newline."""
        self._executor, self._write = executor, write
        self._hash = hashlib.sha256()
        self.messages = 0
        """Number of publications, commands, requests and replies."""

    @property
    def hash(self) -> str:
        """Of all that was said until now, in hexadecimal digits."""
        return self._hash.hexdigest()

    def sent(self, sender: str, channel: Channel, payload: Payload) -> None:
        self._note(sender, channel, channel.pattern.value, payload)
        if self._write:
            self._tell(sender, channel, channel.pattern.value, channel.type.request, payload)

    def answered(self, channel: Channel, reply: Reply) -> None:
        self._note("", channel, reply.status.name, reply.payload)
        if self._write:
            kind = channel.type.response if reply.status is Status.OK else None
            self._tell("", channel, reply.status.name.lower(), kind, reply.payload)

    def _note(self, sender: str, channel: Channel, kind: str, payload: Payload) -> None:
        self.messages += 1
        payload = b"" if payload is None else payload
        self._hash.update(f"{self._executor.now} {sender} {channel.name} {kind} {len(payload)}\n".encode())
        self._hash.update(payload)

    def _tell(self, sender: str, channel: Channel, kind: str, message: Struct | None, payload: Payload) -> None:
        line = {"ns": self._executor.now, **({"from": sender} if sender else {}), "to": channel.name, "kind": kind}
        if message is not None:
            line["values"] = readable(message, _decoder(message)(payload))
        assert self._write
        self._write(f"{json.dumps(line, ensure_ascii=False)}\n")


@lru_cache(maxsize=1024)
def _decoder(message: Struct) -> Decoder:
    return _CODEC.decoder(message)
