"""The connection of a script to a running network."""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from ..closing import Closing
from ..errors import ConfigurationError, DeploymentError
from ..spelling import closest
from .operations import Topic
from .session import NotThere, Session
from .tree import Branch

_LOOK = 0.1
"""Seconds between two looks at what is awaited."""

_PATIENCE = 1.0
"""Seconds until a wait for the network is told."""

log = logging.getLogger(__name__)


def connect(
    network: str | os.PathLike[str] = "",
    *,
    middleware: str | Sequence[str] = (),
    timeout: float = 5.0,
    keys: str | os.PathLike[str] | None = None,
    include: str | os.PathLike[str] | Iterable[str | os.PathLike[str]] = (),
) -> Connection:
    """Take part in a network that rcdeploy runs on this host; without its name, in all that runs here.

    Components on other hosts of the network are there, too. `network` is the name that its DDSL file gives it, or
    `rcdeploy status` shows, or that file. `middleware` restricts the connection to some middlewares. `timeout` is how
    many seconds this function waits for the network, and each call for its answer. `keys` is the folder of the keys of
    an operator, for a network with `security lan`; by default that of its rcdeploy, if it has such keys. `include` is a
    folder of IDSL files, or several, for programs that do not announce their contracts; the current folder and those of
    imports are always searched.

    Raises ConfigurationError if a middleware cannot be used, DeploymentError if the file cannot be read, and NotThere
    if no such network runs in time.
    """
    named = os.fspath(network)
    middlewares = (middleware,) if isinstance(middleware, str) else tuple(middleware)
    if not timeout > 0:
        raise ConfigurationError(f"timeout={timeout!r} must be a positive number of seconds")
    session = Session(named, middlewares, timeout, keys=os.fspath(keys) if keys else None, include=_folders(include))
    end, is_told = time.monotonic() + timeout, False
    try:
        while not session.census().channels:
            if time.monotonic() > end:
                raise _nothing(named, session.lost, middlewares)
            if not is_told and time.monotonic() > end - timeout + _PATIENCE:
                is_told = True
                log.warning("waiting up to %g s: %s", timeout, _nothing(named, session.lost, middlewares))
            time.sleep(_LOOK)
    except BaseException:  # Ctrl-C, too: no scout stays
        session.close()
        raise
    return Connection(session)


def _folders(given: str | os.PathLike[str] | Iterable[str | os.PathLike[str]]) -> list[Path]:
    found = [Path(each) for each in ((given,) if isinstance(given, str | os.PathLike) else given)]
    for each in found:
        if not each.is_dir():
            log.warning("include: %s: there is no such folder", each)
    return found


class Connection(Closing, Branch):
    """A running network. Its components are its attributes, and items: `net.world`, `net["world"]`.

    It may be used from several threads. Close it, use it as a context manager, or leave it: it closes itself when the
    program ends.
    """

    def __init__(self, session: Session) -> None:
        super().__init__(session, ())

    def __getitem__(self, name: str) -> Any:
        try:
            return super().__getitem__(name)
        except NotThere:
            topic = self._session.topic(name) if name.strip("/").count("/") >= 2 else None
            if topic is None:
                raise
            return self._session.kept(topic.name, lambda: Topic(self._session, topic))

    def _rows(self) -> Iterator[tuple[str, str]]:
        yield from super()._rows()
        yield from self._session.lost.items()

    def close(self) -> None:
        """Cancel goals that are not detached, and close all links. Idempotent, from any thread."""
        self._session.close()

    def wait(self, name: str, timeout: float | None = None) -> Any:
        """What has this name, such as `world/LaserPub`, as soon as it is there. Raises NotThere after `timeout`."""
        end = time.monotonic() + (self._session.timeout if timeout is None else timeout)
        while True:
            try:
                return self[name]
            except NotThere:
                if time.monotonic() > end:
                    raise
            time.sleep(_LOOK)


def _nothing(network: str, lost: Mapping[str, str], middlewares: Sequence[str]) -> NotThere:
    if not network:
        return NotThere("no component runs on this host, or none that others can see; start a network with rcdeploy up")
    from ..deploy.client import networks

    try:
        running = networks()
    except DeploymentError:
        running = []
    if network in running:
        why = "".join(f"; {each}" for each in lost.values())
        over = f" over {' or '.join(middlewares)}" if middlewares else ""
        ready = f"network `{network}` runs, and none of its components is ready{over}: rcdeploy status {network}"
        return NotThere(ready + why)
    near = closest(network, running)
    hint = (
        f"did you mean `{near}`?" if near else f"running: {', '.join(running)}" if running else "start it with rcdeploy"
    )
    return NotThere(f"no network `{network}` runs on this host; {hint}")
