"""The two parties that a comparison is between: our framework, and the bare library under one of its transports."""

from __future__ import annotations

from functools import partial
from types import ModuleType

from .parties import Party


def ours(middleware: str) -> Party:
    from .ours import Far, Near

    return Party(partial(Far, middleware), partial(Near, middleware), apart=middleware != "inproc")


def raw(middleware: str) -> Party | None:
    """The bare library under one of our transports, if there is one; imported only if used."""
    match middleware:
        case "zeromq":
            from . import raw_zeromq

            return _bare(raw_zeromq)
        case "dds":
            from . import raw_dds

            return _bare(raw_dds)
        case "zenoh":
            from . import raw_zenoh

            return _bare(raw_zenoh)
        case "shm":
            from . import raw_shm

            return _bare(raw_shm)
        case "ice":
            from . import raw_ice

            return _bare(raw_ice)
    return None


def _bare(module: ModuleType) -> Party:
    return Party(module.Far, module.Near, module.encode, module.decode)
