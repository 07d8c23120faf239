"""The server's links, which are operations of objects."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ...wire.codec import Payload
from ...wire.header import Request
from ..base import Reply, Status
from ..leader_followers import Job
from ..server import CommandInlet as _CommandInlet
from ..server import Server as _Server
from ..server import ServingLink
from .messages import NOTHING
from .served import nothing

if TYPE_CHECKING:
    from .core import IceCore


class _Held(ServingLink):
    """A link that stays part of its object until none of its handlers runs any more."""

    transport: IceCore

    def release(self) -> None:
        try:
            super().release()
        finally:
            self.transport.let_go(self)


class Server(_Held, _Server):
    def take(self, request: Request, payload: Payload, expires: float, answer: Any) -> Job | None:
        requests = self.transport.requests
        if requests.is_full:
            self.stats.dropped += 1
            answer(Reply(Status.BUSY))
            return nothing
        job = super().take(request, payload, expires, answer)
        return job and requests.add(request.client, job, len(payload))


class CommandInlet(_Held, _CommandInlet):
    def accept(self, payload: Payload, expires: float, answer: Any) -> Job | None:
        """Queue a command. A client that expects a reply gets it when the command is queued."""
        job = super().accept(payload, expires, answer)
        answer(Reply(Status.OK, NOTHING) if job else Reply(Status.BUSY))
        return job
