"""The Zenoh session of a transport, and the router that it connects to.

Every component is a client of one router. With `connect`, it uses the router at that address; `here/NAME` is a router
behind a socket of that name in the run-time folder, such as `rcdeploy` starts on each host of a network.

Otherwise the components share a router behind a socket in the run-time folder. The process that holds the claim on it
runs the router. When that process ends, another one claims it, and Zenoh's clients reconnect automatically.

A process that runs the router from its start uses it as its own session. A separate client in the same process would
share its reading threads with the router. The router may block these threads, and then both wait for each other until
the connection times out.

A program that starts components may run the router for them (`shared_router`), in a dedicated process. That router
outlives the components, and no debugger stops it.
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
from ..border import translating
from ..directory import LONGEST_SOCKET
from ..exclusive import Claim, holder, try_claim
from ..runtime_folder import runtime_dir
from .hearing import Hearing
from .neighbours import Neighbours

log = logging.getLogger("robocomp.transport.zenoh")

OPEN_TIMEOUT = 10.0
"""Seconds that opening waits for a router."""

_DEDICATED_TIMEOUT = 60.0
"""The same for a dedicated router, which is slow to answer when many components start at once."""

HERE = "here"

LOST_AFTER = 1.0
"""Seconds without a connection to the router before a warning: replacing a router takes less."""

_ATTEMPT_MS = 1000
"""Milliseconds of one attempt to connect. Between two attempts we check whether we have to run the router ourselves.

If another process runs it for all, each attempt takes twice as long as the one before. Otherwise the attempts of many
components would keep each other from succeeding.
"""
_LONGEST_ATTEMPT_MS = 8000

_LEASE_MS = 2000
"""Milliseconds after which a hung process counts as gone."""

_WAIT = "transport/link/tx/queue/congestion_control/block/wait_before_close"
"""Microseconds for which a reliable message waits for a peer that does not read. Then the connection is closed.

While a router waits for a reader, it does not read from the sender. If that takes as long as the lease, the router
gives up the sender, too, and its messages are lost for all readers. A router waits for one reader after the other, so
three that hang at once are no harm. Senders wait longer than any router, for the same reason.
"""
_WAITS = {_WAIT: 5_000_000}
_ROUTER_WAITS = {_WAIT: 500_000}
_ROUTER_OF_A_HOST_WAITS = {_WAIT: 1_500_000}
"""The link to another host may be slow: 6 MB take more than a second at 30 Mbit/s."""

_COMMON: dict[str, Any] = {
    "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": False,
    "scouting/delay": 0,  # by default, opening a router takes 0.5 s
    "timestamping/enabled": False,
    "transport/shared_memory/enabled": False,  # leaves files behind when killed
    "transport/link/rx/max_message_size": MAX_BYTES + 65536,
    "transport/link/tx/lease": _LEASE_MS,
    "transport/link/tx/keep_alive": 4,
    "transport/link/tx/queue/size/data": 16,  # batches of 64 KiB; a burst of small messages finds room
    "transport/link/tx/queue/size/interactive_high": 16,  # calls, answers, commands
    **_WAITS,
    "transport/link/tx/queue/congestion_control/drop/max_wait_before_drop_fragments": 1_000_000,  # µs; large messages
    "transport/unicast/open_timeout": 2000,
    "transport/unicast/accept_timeout": 2000,
    "transport/unicast/accept_pending": 1000,
    "transport/unicast/max_sessions": 10_000,
}
_RUNTIME = "ZENOH_RUNTIME"
_THREADS = "(rx: (worker_threads: 16), net: (worker_threads: 4))"
"""Zenoh's threads in a process, for all its sessions; the first session decides.

`rx` reads: 16 threads instead of 2, because a router blocks a thread while a reader is slow. `net` reports lost
peers: 4 threads instead of 1. These need Python's global lock, which the thread that frees a closed router holds until
one of them has ended a task of that router. If none can, Zenoh gives up after 10 s, in which no Python code runs.

An idle thread costs 50 KB.
"""

_DEDICATED = "router apart"
"""The claim that marks the router of the run-time folder as dedicated."""

_RETRY = {"period_init_ms": 50, "period_max_ms": 1000, "period_increase_factor": 2}
_RETRY_HERE = _RETRY | {"period_max_ms": 200}  # a socket file costs nothing to try


as_transport_error = translating("zenoh", zenoh.ZError)


_DEDICATED_SETTINGS: dict[str, Any] = {
    "transport/link/tx/lease": 10_000,  # ms; longer, because losing this router makes work for all components at once
    "transport/unicast/accept_timeout": _LONGEST_ATTEMPT_MS,
}
"""Settings of a dedicated router, which may get little processor time while hundreds of components start."""


def open_router(endpoint: str, more: Mapping[str, Any] | None = None) -> zenoh.Session:
    """A router that listens only at that endpoint; `more` are further settings. The caller closes it."""
    with as_transport_error(f"listening at {endpoint}"), _reading_like_a_router():
        return zenoh.open(_config("router", {**_ROUTER_WAITS, "listen/endpoints": [endpoint], **(more or {})}))


def open_client(endpoint: str, more: Mapping[str, Any] | None = None) -> zenoh.Session:
    """A client of the router at that endpoint; it survives restarts of the router. `more` are further settings.

    Raises ZError if the router does not answer within a second.
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
    """Run the router `here/NAME`. The settings, in Zenoh's format, add endpoints to listen at and to connect to.

    Raises TransportError if that router is running already.
    """
    folder = _folder(f"{name}.sock")
    claim = try_claim(folder, f"router {name}", name)
    if claim is None:
        raise TransportError(f"zenoh: the router `{name}` is already run by {holder(folder, f'router {name}')}")
    socket = folder / f"{name}.sock"
    session: zenoh.Session | None = None
    try:
        socket.unlink(missing_ok=True)  # left by one that was killed
        listen = [f"unixsock-stream/{socket}", *settings.get("listen/endpoints", ())]
        keep_trying = {"connect/timeout_ms": -1, "connect/exit_on_failure": False, "connect/retry": _RETRY}
        keep_trying |= _ROUTER_OF_A_HOST_WAITS
        # The other routers may start later.
        with as_transport_error(f"listening at {', '.join(listen)}"), _reading_like_a_router():
            session = zenoh.open(_config("router", {**keep_trying, **settings, "listen/endpoints": listen}))
        with Neighbours(session):
            yield
    finally:
        with contextlib.ExitStack() as everything:  # from the last line to the first, and all of it whatever fails
            everything.callback(claim.close)
            everything.callback(socket.unlink, missing_ok=True)
            if session:
                everything.callback(session.close)


def resolved(connect: str) -> str:
    """The endpoint in Zenoh's own form: `here/NAME` becomes the path of a socket."""
    kind, _, name = connect.partition("/")
    return f"unixsock-stream/{_folder(f'{name}.sock') / f'{name}.sock'}" if kind == HERE else connect


@contextlib.contextmanager
def shared_router(owner: str) -> Iterator[None]:
    """Run the router of the run-time folder, unless it is running. Afterwards, one of the components takes over."""
    router = _SharedRouter(owner)
    try:
        router.run_if_free(dedicated=True)
        yield
    finally:
        router.close()


class Network:
    """A session that stays connected. `tick` has to be called regularly."""

    def __init__(
        self,
        connect: str,
        owner: str,
        settings: Mapping[str, Any] | None = None,
        wanted: Callable[[], bool] = lambda: True,
        why_refused: Callable[[str], str] = lambda endpoint: "",
        do: Callable[[Callable[[], object]], object] = lambda job: job(),
    ) -> None:
        """`settings` are further settings of the client, in Zenoh's format; `wanted`: see `base.TransportConfig`.

        `why_refused` returns the reason why the router at an endpoint refuses us, or "" if it is not known to refuse.
        That may take seconds, so `tick` has `do` call it on another thread.
        """
        self._do = do
        self._owner, self._settings, self._wanted, self._why_refused = owner, settings, wanted, why_refused
        self._router = None if connect else _SharedRouter(owner)
        self._here = connect.startswith(f"{HERE}/")
        self.endpoint = resolved(connect) if connect else _SharedRouter.endpoint()
        self._dedicated = False
        """Whether the router is expected to outlive this process."""
        self._connected_at = time.monotonic()
        self._connected, self._logged = True, False
        """Whether we are connected, and whether a lost connection was logged."""
        try:
            self.session = self._open()
            self._hearing = None if self.is_router else Hearing(self.session, self.endpoint, do)
        except BaseException:
            self._close_router()
            raise

    @property
    def is_router(self) -> bool:
        """Whether this session is the router."""
        return self._router is not None and self._router.session is self.session

    @property
    def stable(self) -> bool:
        """Whether no component will have to take over the router soon."""
        return self.is_router or (self._dedicated and self._connected)

    def tick(self) -> None:
        """Run the router if no process does any more; log if the present router does not answer."""
        if self._hearing:
            self._hearing.tick()
        self._connected = self.is_router or bool(self.session.info.routers_zid())
        if self._connected:
            if self._logged:
                log.info("%s: the Zenoh router answers again", self._owner or "zenoh")
            self._connected_at, self._logged = time.monotonic(), False
            return
        self._run_router()
        if not self._logged and time.monotonic() - self._connected_at >= LOST_AFTER:
            self._logged = True
            self._do(self._log_lost)

    def _log_lost(self) -> None:
        owner, where = self._owner or "zenoh", self._where()
        if why := self._why_refused(self.endpoint):
            log.error("%s: the Zenoh router at %s refuses this process: %s", owner, where, why)
        else:
            log.warning("%s: no Zenoh router answers at %s; no peer can be reached until one does", owner, where)

    def close(self) -> None:
        try:
            if not self.is_router:
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
            busy = self._router.is_dedicated() if self._router else self._here
            self._dedicated = busy or self._router is None
            settings = {**_attempt(attempt if busy else _ATTEMPT_MS), **(self._settings or {})}
            attempt = min(2 * attempt, _LONGEST_ATTEMPT_MS)
            try:
                with contextlib.nullcontext() if self._dedicated else _reading_like_a_router():
                    return open_client(self.endpoint, settings)
            except zenoh.ZError as exc:
                if not self._wanted():
                    raise Closed("zenoh: stopped while waiting for a router") from exc
                if why := self._why_refused(self.endpoint):
                    raise Refused(f"the Zenoh router at {self._where()} refuses this process: {why}") from exc
                if attempts == 0 and not busy:
                    log.info("%s: waiting for a Zenoh router at %s", self._owner or "zenoh", self._where())
                attempts += 1
                if time.monotonic() - begun >= (_DEDICATED_TIMEOUT if busy else OPEN_TIMEOUT):
                    raise TransportError(f"no Zenoh router answers at {self._where()}") from exc

    def _run_router(self) -> None:
        if self._router:
            self._router.run_if_free()

    def _where(self) -> str:
        return f"{self.endpoint} (run by {self._router.holder()})" if self._router else self.endpoint

    def _close_router(self) -> None:
        if self._router:
            self._router.close()


def _attempt(ms: int) -> dict[str, Any]:
    """The settings for one attempt to connect of that duration."""
    return {
        "connect/timeout_ms": ms,
        "transport/unicast/open_timeout": max(ms, _COMMON["transport/unicast/open_timeout"]),
    }


class _SharedRouter:
    """The router of a run-time folder, which one of its clients runs."""

    def __init__(self, owner: str) -> None:
        self._folder, self._owner = _folder(), owner
        self._claim: Claim | None = None
        self._dedicated: Claim | None = None
        self.session: zenoh.Session | None = None
        self._lock = threading.Lock()
        self._closed = False

    @staticmethod
    def endpoint() -> str:
        return f"unixsock-stream/{_folder() / 'router.sock'}"

    def run_if_free(self, *, dedicated: bool = False) -> None:
        """`dedicated`: this process does nothing else, so no client has to take over while it runs."""
        with self._lock:
            if self.session or self._closed:
                return
            self._claim = self._claim or try_claim(self._folder, "router", self._owner)
            if self._claim:
                if dedicated:
                    self._dedicated = try_claim(self._folder, _DEDICATED, self._owner)
                (self._folder / "router.sock").unlink(missing_ok=True)  # left by one that was killed
                self.session = open_router(self.endpoint(), _DEDICATED_SETTINGS if self._dedicated else None)

    def is_dedicated(self) -> bool:
        """Whether a dedicated process runs the router, which then outlives its clients."""
        process = self.holder()
        # A killed process may have left the second claim.
        return "(pid" in process and holder(self._folder, _DEDICATED) == process

    def holder(self) -> str:
        return holder(self._folder, "router")

    def close(self) -> None:
        with self._lock:
            self._closed = True
            with contextlib.ExitStack() as everything:  # from the last line to the first, and all of it whatever fails
                for claim in (self._claim, self._dedicated):
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
            f"run-time folder {folder}: the path of its socket would have {len(os.fsencode(socket))} bytes, "
            f"but the limit is {LONGEST_SOCKET}; set ROBOCOMP_RUNTIME_DIR to a shorter path"
        )
    folder.mkdir(mode=0o700, exist_ok=True)
    return folder


@contextlib.contextmanager
def _reading_like_a_router() -> Iterator[None]:
    """Within this, the first session of the process gets many reading threads."""
    if _RUNTIME in os.environ:
        yield
        return
    os.environ[_RUNTIME] = _THREADS
    try:
        yield
    finally:
        os.environ.pop(_RUNTIME, None)  # our child processes must not inherit it


def _config(mode: str, settings: dict[str, Any]) -> zenoh.Config:
    config = zenoh.Config()
    for key, value in ({"mode": mode} | _COMMON | settings).items():
        try:
            config.insert_json5(key, json.dumps(value))
        except zenoh.ZError as exc:
            raise ConfigurationError(f"zenoh does not accept {value!r} for `{key}`: {exc}") from exc
    return config
