"""The border to a library or to the system: their exceptions become TransportErrors there."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from typing import Any

from ..errors import TransportError

AsTransportError = Callable[[object], AbstractContextManager[None]]
"""Makes a context from what is done in it, such as `joining the domain`."""


def translating(
    transport: str, foreign: type[Exception] | tuple[type[Exception], ...], reason: Callable[[Any], str] = str
) -> AsTransportError:
    """Contexts in which foreign exceptions become TransportErrors, with the message `TRANSPORT: DOING: REASON`."""

    @contextlib.contextmanager
    def as_transport_error(doing: object) -> Iterator[None]:
        try:
            yield
        except foreign as exc:
            raise TransportError(f"{transport}: {doing}: {reason(exc)}") from exc

    return as_transport_error
