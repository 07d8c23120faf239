"""The two parties that a comparison is between: our framework, and the bare library under one of its transports."""

from __future__ import annotations

from functools import partial

from .parties import Party


def ours(middleware: str) -> Party:
    from .ours import Far, Near

    return Party(partial(Far, middleware), partial(Near, middleware), apart=middleware != "inproc")


def raw(middleware: str) -> Party | None:
    """The bare library under one of our transports, if there is one; imported only if used."""
    match middleware:
        case "zeromq":
            from . import raw_zeromq as bare
        case "dds":
            from . import raw_dds as bare  # type: ignore[no-redef]  # they look alike
        case "zenoh":
            from . import raw_zenoh as bare  # type: ignore[no-redef]
        case "shm":
            from . import raw_shm as bare  # type: ignore[no-redef]
        case "ice":
            from . import raw_ice as bare  # type: ignore[no-redef]
        case _:
            return None
    return Party(bare.Far, bare.Near, bare.encode, bare.decode)
