"""How the Zenoh transport reaches the others: a client's session, and the router it needs.

Every component is a client of one router. Told an address (`connect`), it uses the router there; `here/NAME` is one
that somebody runs behind a socket of that name in the run-time folder, as `rcdeploy` does on each host of a network.
Otherwise the components of a run-time folder find or host one behind a socket in that folder:
whoever claims it runs the router; when that process ends, another one claims it, and Zenoh's
clients reconnect by themselves. Who ran it from the beginning uses it as its own session: a client
beside it in the same process would have to be read by threads that the router may keep waiting,
for that client among others, and then nothing moves until the connection is given up. Whoever
starts components may run it for them beforehand (`shared_router`), in a process that does nothing
else: it then outlives them, and no debugger stops it.
"""

from __future__ import annotations

import contextlib
import json
import logging
import os
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import zenoh

from ...errors import Closed, ConfigurationError, Refused, TransportError
from ...wire.codec import MAX_BYTES
from ..directory import LONGEST_SOCKET, runtime_dir
from ..exclusive import Claim, holder, try_claim

log = logging.getLogger("robocomp.transport.zenoh")

OPEN_PATIENCE = 10.0
"""Seconds after which opening gives up to reach a router."""

_BUSY_PATIENCE = 60.0
"""The same where somebody runs one for all, and so many start at once that it takes its time."""

HERE = "here"

LOST = 1.0
"""Seconds without a connection to the router after which that is told: a new one is there sooner."""

_ATTEMPT_MS = 1000
"""One attempt to connect; between two of them we look whether the router has become ours to run.

If that will not be, each takes twice as long as the one before: as many as have to try again must not keep others,
whose turn it would be, from succeeding.
"""
_LONGEST_ATTEMPT_MS = 8000

_COMMON: dict[str, Any] = {
    "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": False,
    "scouting/delay": 0,  # a router waits for so long when it opens: 0.5 s, unless told
    "timestamping/enabled": False,
    "transport/shared_memory/enabled": False,  # leaves files behind when killed
    "transport/link/rx/max_message_size": MAX_BYTES + 65536,
    "transport/link/tx/lease": 2000,  # ms after which a hung process counts as gone
    "transport/link/tx/keep_alive": 4,
    "transport/link/tx/queue/size/data": 16,  # batches of 64 KiB; a burst of small messages finds room
    "transport/link/tx/queue/size/interactive_high": 16,  # calls, answers, commands
    "transport/link/tx/queue/congestion_control/block/wait_before_close": 2_000_000,  # µs; as the lease: it hangs
    "transport/link/tx/queue/congestion_control/drop/max_wait_before_drop_fragments": 1_000_000,  # µs; of large ones
    "transport/unicast/open_timeout": 2000,
    "transport/unicast/accept_timeout": 2000,
    "transport/unicast/accept_pending": 1000,
    "transport/unicast/max_sessions": 10_000,
}
_RUNTIME = "ZENOH_RUNTIME"
_THREADS = "(rx: (worker_threads: 16), net: (worker_threads: 4))"
"""Those that read, for all sessions of a process, instead of 2: a router has them wait where a reader is slow. And
those that tell what has gone, instead of 1: they need Python's lock for that, and whoever frees a router that was
closed has it until one of them has ended a task of that router. If none can, Zenoh gives up after 10 s, in which no
Python runs.

The first session decides. Idle ones cost 50 KB each, and no time.
"""

_APART = "router apart"
"""What is claimed, besides the router, by who starts components."""

_RETRY = {"period_init_ms": 50, "period_max_ms": 1000, "period_increase_factor": 2}
_RETRY_HERE = _RETRY | {"period_max_ms": 200}  # a socket file costs nothing to try


@contextlib.contextmanager
def as_transport_error(doing: str) -> Iterator[None]:
    try:
        yield
    except zenoh.ZError as exc:
        raise TransportError(f"zenoh: {doing}: {exc}") from exc


_APART_SETTINGS: dict[str, Any] = {
    "transport/link/tx/lease": 10_000,  # so long a component bears with it: a loss means work for all at once
    "transport/unicast/accept_timeout": _LONGEST_ATTEMPT_MS,
}
"""Of a router that is run for all, and may get little of a machine on which hundreds begin."""


def open_router(endpoint: str, more: Mapping[str, Any] | None = None) -> zenoh.Session:
    """A router listening there, and nowhere else. Close it. `more` are settings besides."""
    with as_transport_error(f"listening at {endpoint}"), _reading_like_a_router():
        return zenoh.open(_config("router", {"listen/endpoints": [endpoint], **(more or {})}))


def open_client(endpoint: str, more: Mapping[str, Any] | None = None) -> zenoh.Session:
    """A client of the router there, which need not stay there all the time; `more` are settings besides.

    Raises ZError if it does not answer within a second.
    """
    retry = _RETRY_HERE if endpoint.startswith("unixsock-stream/") else _RETRY
    settings = {
        "connect/endpoints": [endpoint],
        "connect/timeout_ms": _ATTEMPT_MS,
        "connect/exit_on_failure": True,
        "connect/retry": retry,
        "listen/endpoints": [],
    }
    return zenoh.open(_config("client", settings | dict(more or {})))


@contextlib.contextmanager
def named_router(name: str, settings: Mapping[str, Any]) -> Iterator[None]:
    """Run the router `here/NAME`, which listens and connects elsewhere, too, as the settings say, in Zenoh's own words.

    Raises TransportError if there is one.
    """
    folder = _folder(f"{name}.sock")
    claim = try_claim(folder, f"router {name}", name)
    if claim is None:
        raise TransportError(f"zenoh: the router `{name}` is run by {holder(folder, f'router {name}')} already")
    socket = folder / f"{name}.sock"
    session: zenoh.Session | None = None
    try:
        socket.unlink(missing_ok=True)  # left by one that was killed
        listen = [f"unixsock-stream/{socket}", *settings.get("listen/endpoints", ())]
        apart = {"connect/timeout_ms": -1, "connect/exit_on_failure": False, "connect/retry": _RETRY}  # they come later
        with as_transport_error(f"listening at {', '.join(listen)}"), _reading_like_a_router():
            session = zenoh.open(_config("router", {**apart, **settings, "listen/endpoints": listen}))
        yield
    finally:
        with contextlib.ExitStack() as everything:  # from the last line to the first, and all of it whatever fails
            everything.callback(claim.close)
            everything.callback(socket.unlink, missing_ok=True)
            if session:
                everything.callback(session.close)


def resolved(connect: str) -> str:
    """An endpoint as Zenoh knows it."""
    kind, _, name = connect.partition("/")
    return f"unixsock-stream/{_folder(f'{name}.sock') / f'{name}.sock'}" if kind == HERE else connect


@contextlib.contextmanager
def shared_router(owner: str) -> Iterator[None]:
    """Run the router of the run-time folder, unless somebody does; one of those who need it takes over at the end."""
    router = _SharedRouter(owner)
    try:
        router.run_if_nobody_does(apart=True)
        yield
    finally:
        router.close()


class Network:
    """A session that stays connected. `tick` has to be called now and then."""

    def __init__(
        self,
        connect: str,
        owner: str,
        settings: Mapping[str, Any] | None = None,
        wanted: Callable[[], bool] = lambda: True,
        why_refused: Callable[[str], str] = lambda endpoint: "",
        do: Callable[[Callable[[], object]], object] = lambda job: job(),
    ) -> None:
        """`settings` are more of a client's, in Zenoh's own words; `wanted`: see `base.TransportConfig`.

        `why_refused` tells why the router at an endpoint does not let us in; "" if it is not known to refuse. That may
        take seconds, so `tick` has it done by `do`.
        """
        self._do = do
        self._owner, self._settings, self._wanted, self._why_refused = owner, settings, wanted, why_refused
        self._router = None if connect else _SharedRouter(owner)
        self._here = connect.startswith(f"{HERE}/")
        self.endpoint = resolved(connect) if connect else _SharedRouter.endpoint()
        self._apart = False
        """Whether the router is nobody's who may end before us."""
        self._connected_at = time.monotonic()
        self._connected, self._told = True, False
        """And whether it was told that we are not."""
        try:
            self.session = self._open()
        except BaseException:
            self._close_router()
            raise

    @property
    def at_home(self) -> bool:
        """Whether the router is this session."""
        return self._router is not None and self._router.session is self.session

    @property
    def settled(self) -> bool:
        """Whether nobody will have to run the router soon."""
        return self.at_home or (self._apart and self._connected)

    def tick(self) -> None:
        """Run the router if nobody does any more, and tell if the one there is does not answer."""
        self._connected = self.at_home or bool(self.session.info.routers_zid())
        if self._connected:
            if self._told:
                log.info("%s: the Zenoh router answers again", self._owner or "zenoh")
            self._connected_at, self._told = time.monotonic(), False
            return
        self._run_router()
        if not self._told and time.monotonic() - self._connected_at >= LOST:
            self._told = True
            self._do(self._tell_lost)

    def _tell_lost(self) -> None:
        who, where = self._owner or "zenoh", self._where()
        if why := self._why_refused(self.endpoint):
            log.error("%s: the Zenoh router at %s turns this process away: %s", who, where, why)
        else:
            log.warning("%s: no Zenoh router answers at %s; until it does, nobody is reached", who, where)

    def close(self) -> None:
        try:
            if not self.at_home:
                with contextlib.suppress(zenoh.ZError):
                    self.session.close()  # type: ignore[no-untyped-call]  # zenoh's stub lacks it
        finally:
            self._close_router()

    def _open(self) -> zenoh.Session:
        begun, attempt, attempts = time.monotonic(), _ATTEMPT_MS, 0
        while True:
            self._run_router()
            if self._router and self._router.session:
                return self._router.session
            busy = self._router.is_apart() if self._router else self._here
            self._apart = busy or self._router is None
            settings = {**_attempt(attempt if busy else _ATTEMPT_MS), **(self._settings or {})}
            attempt = min(2 * attempt, _LONGEST_ATTEMPT_MS)
            try:
                with contextlib.nullcontext() if self._apart else _reading_like_a_router():
                    return open_client(self.endpoint, settings)
            except zenoh.ZError as exc:
                if not self._wanted():
                    raise Closed("zenoh: asked to end while waiting for a router") from exc
                if why := self._why_refused(self.endpoint):
                    raise Refused(f"the Zenoh router at {self._where()} turns this process away: {why}") from exc
                if attempts == 0 and not busy:
                    log.info("%s: waiting for a Zenoh router at %s", self._owner or "zenoh", self._where())
                attempts += 1
                if time.monotonic() - begun >= (_BUSY_PATIENCE if busy else OPEN_PATIENCE):
                    raise TransportError(f"no Zenoh router answers at {self._where()}") from exc

    def _run_router(self) -> None:
        if self._router:
            self._router.run_if_nobody_does()

    def _where(self) -> str:
        return f"{self.endpoint} (run by {self._router.holder()})" if self._router else self.endpoint

    def _close_router(self) -> None:
        if self._router:
            self._router.close()


def _attempt(ms: int) -> dict[str, Any]:
    """What has one attempt to connect take so long."""
    return {
        "connect/timeout_ms": ms,
        "transport/unicast/open_timeout": max(ms, _COMMON["transport/unicast/open_timeout"]),
    }


class _SharedRouter:
    """The router of a run-time folder, run by one of those who need it."""

    def __init__(self, owner: str) -> None:
        self._folder, self._owner = _folder(), owner
        self._claim: Claim | None = None
        self._apart: Claim | None = None
        self.session: zenoh.Session | None = None
        self._lock = threading.Lock()
        self._closed = False

    @staticmethod
    def endpoint() -> str:
        return f"unixsock-stream/{_folder() / 'router.sock'}"

    def run_if_nobody_does(self, *, apart: bool = False) -> None:
        """`apart`: as long as we are there, nobody else will have to."""
        with self._lock:
            if self.session or self._closed:
                return
            self._claim = self._claim or try_claim(self._folder, "router", self._owner)
            if self._claim:
                if apart:
                    self._apart = try_claim(self._folder, _APART, self._owner)
                (self._folder / "router.sock").unlink(missing_ok=True)  # left by one that was killed
                self.session = open_router(self.endpoint(), _APART_SETTINGS if self._apart else None)

    def is_apart(self) -> bool:
        """Whether the router is run by who starts components, and outlives them."""
        who = self.holder()
        return "(pid" in who and holder(self._folder, _APART) == who  # else what somebody left who was killed

    def holder(self) -> str:
        return holder(self._folder, "router")

    def close(self) -> None:
        with self._lock:
            self._closed = True
            with contextlib.ExitStack() as everything:  # from the last line to the first, and all of it whatever fails
                for claim in (self._claim, self._apart):
                    if claim:
                        everything.callback(claim.close)
                if self.session:
                    everything.callback((self._folder / "router.sock").unlink, missing_ok=True)
                    everything.callback(self.session.close)


def _folder(socket_name: str = "router.sock") -> Path:
    folder = runtime_dir("zenoh")
    socket = folder / socket_name
    if len(os.fsencode(socket)) > LONGEST_SOCKET:
        raise ConfigurationError(
            f"run-time folder {folder}: the path of the socket in it would have {len(os.fsencode(socket))} bytes, "
            f"and {LONGEST_SOCKET} is the limit; set ROBOCOMP_RUNTIME_DIR to a shorter path"
        )
    folder.mkdir(mode=0o700, exist_ok=True)
    return folder


@contextlib.contextmanager
def _reading_like_a_router() -> Iterator[None]:
    """Have a session opened that reads with many threads, if it is the first one of this process."""
    if _RUNTIME in os.environ:
        yield
        return
    os.environ[_RUNTIME] = _THREADS
    try:
        yield
    finally:
        os.environ.pop(_RUNTIME, None)  # not for those that we start


def _config(mode: str, settings: dict[str, Any]) -> zenoh.Config:
    config = zenoh.Config()
    for key, value in ({"mode": mode} | _COMMON | settings).items():
        try:
            config.insert_json5(key, json.dumps(value))
        except zenoh.ZError as exc:
            raise ConfigurationError(f"zenoh does not take {value!r} for `{key}`: {exc}") from exc
    return config
