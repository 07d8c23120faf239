"""The diary of a component: all that enters its code and all that leaves it, written by an installed plug-in.

A component without `diary` in its configuration does not import this module.
"""

from __future__ import annotations

from typing import Any, Protocol

from .. import installed
from ..errors import ConfigurationError, RobocompError
from .settings import Settings
from .worker import Worker

DIARIES, FORMAT = "robocomp_py.diaries", "mcap"
"""The group of entry points, and the only entry in it."""


class Diary(Protocol):
    """Notes what one component does. Made with the path of its file and the settings of the component."""

    def note_worker(self, worker: Worker[Any]) -> None:
        """Replace methods of a worker, before anything has taken them from it."""

    def note_proxies(self, worker: Worker[Any]) -> None:
        """Replace operations of its proxies, once they are connected."""

    def close(self) -> None:
        """Finish the file, after the last call. Idempotent."""


def opened(settings: Settings) -> Diary:
    """The diary that the configuration of a component wants. Raises ConfigurationError."""
    made: Any = installed.find(DIARIES, FORMAT)
    if made is None:
        raise ConfigurationError("`component.diary` needs an installation of robocomp-py with its entry points")
    try:
        diary: Diary = made(settings.diary, settings)
    except ConfigurationError:
        raise
    except RobocompError as exc:
        raise ConfigurationError(f"component.diary: {exc}") from exc
    return diary
