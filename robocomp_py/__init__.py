"""Components for robots in Python, whatever the middleware.

No layer is imported here: using one must not load them all.
"""

from .version import __version__ as __version__

TYPE_CHECKING = False  # as in `typing`, which would be loaded for it alone
if TYPE_CHECKING:
    from .client import connect as connect


def __getattr__(name: str) -> object:
    """`connect` is imported when it is first used."""
    if name != "connect":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from .client import connect

    return connect


def __dir__() -> list[str]:
    return sorted({*globals(), "connect"})
