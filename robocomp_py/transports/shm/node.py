"""The use of iceoryx2: nodes, and the ports through which samples pass.

    a queue     one reader, several writers; refuses messages when it is full
    a topic     one writer, several readers; a slow reader loses the oldest messages

What iceoryx2 keeps in files is below a folder of the user's own. What it keeps in shared memory has names that begin
with a prefix made of that folder and of a secret in it, so users, and run-time folders, do not meet. `/dev/shm` is open
to all users: without the secret, another one could make files of these names first. Names can be seen there, so the
secret is a new one each time that the first node of a folder opens. What killed processes have left is removed by the
next node.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import time
from pathlib import Path
from typing import Any

import iceoryx2

from ...errors import ConfigurationError, TransportError
from ..border import translating
from .heap import Heap, Heaps, remove_dead
from .room import OPENING, SHARED_MEMORY, check_room, hindrance, prefix, what_is_short
from .unsafe import OCTETS

PORTS = 512
"""Maximum number of writers of one queue: other transports of this host, and their threads."""

READERS = 128
"""Maximum number of readers of one topic."""

SLOT_BYTES = 4096
"""Size of the slots of a port. Payloads that do not fit lie in a heap."""

_LONGEST_FOLDER = 100
"""Bytes in the path of a run-time folder: iceoryx2 adds up to 140 to it, and panics beyond 255."""

_PATIENCE = 5.0
"""Maximum seconds to wait for processes that are entering or leaving."""

_PATIENCE_MS = 500
"""How long iceoryx2, and the interpreter with it, waits for a process that is creating a resource."""

_FAILURES = tuple(each for each in vars(iceoryx2).values() if isinstance(each, type) and issubclass(each, Exception))

iceoryx2.set_log_level_from_env_or(iceoryx2.LogLevel.Fatal)  # this package logs failures itself, once


as_transport_error = translating("shm", _FAILURES, lambda exc: f"{exc}{what_is_short()}")


_SECRET = re.compile(r"[0-9a-f]{16}")


class Node:
    """This process, or one of its transports, as iceoryx2 sees it, and its heap.

    Names and the number are unique among all nodes of the folder.
    """

    def __init__(self, folder: Path, number: int) -> None:
        self.folder, self._root = folder, folder / "i"
        self._family, self._secret = prefix(folder), folder / "secret"
        self._dead: list[Any] = []
        """Nodes of killed processes, whose remains are not removed yet."""
        length = len(os.fsencode(folder.parent))
        if length > _LONGEST_FOLDER:
            raise ConfigurationError(
                f"run-time folder {folder.parent}: its path has {length} bytes, and {_LONGEST_FOLDER} is the limit; "
                "set ROBOCOMP_RUNTIME_DIR to a shorter path"
            )
        if not os.access(SHARED_MEMORY, os.W_OK | os.X_OK):
            raise TransportError(
                f"shm: {SHARED_MEMORY} is not there, or cannot be written to; mount it (mount -t tmpfs tmpfs "
                f"{SHARED_MEMORY}), or choose another middleware"
            )
        check_room(OPENING)
        self._lock = _Lock(folder / "nodes.lock")
        with contextlib.ExitStack() as undo:
            undo.callback(self._lock.release)
            alone = self._lock.take()
            known = self._known_secret()
            self._use(known or os.urandom(8).hex())
            if (alone and self._clear()) or not known:
                self._use(self._new_secret())
            builder = iceoryx2.NodeBuilder.new().config(self._config)
            builder = builder.signal_handling_mode(iceoryx2.SignalHandlingMode.Disabled)  # Python handles signals
            self.heap, self.heaps = Heap(self._prefix, number), Heaps(self._prefix)
            undo.callback(self.heap.close)
            try:
                with as_transport_error("opening a node"):
                    self._node: Any = builder.create(iceoryx2.ServiceType.Ipc)
                for shared in self._common():
                    shared.chmod(0o600)
            except TransportError as exc:
                raise TransportError(f"{exc}{self._in_the_way()}") from exc
            except OSError as exc:
                reason = f"{exc.strerror}{what_is_short()}{self._in_the_way()}"
                raise TransportError(f"shm: opening a node: {SHARED_MEMORY}: {reason}") from exc
            self._lock.share()
            undo.pop_all()

    def close(self) -> None:
        """Leave. Idempotent. Samples in use (by an array, for example) are released when they are no longer used."""
        self.heap.close()
        self.heaps.close()
        self._node = None
        try:
            if self._root.exists() and self._lock.is_last():  # otherwise the folder was removed, or others will clear
                self._clear()
        finally:
            self._lock.release()

    def _use(self, secret: str) -> None:
        self._own_secret, self._prefix = secret, f"{self._family}{secret}_"
        self._config = iceoryx2.config.default()
        settings = self._config.global_cfg
        settings.root_path = iceoryx2.Path.new(str(self._root))
        settings.prefix = iceoryx2.FileName.new(self._prefix)
        settings.creation_timeout = iceoryx2.Duration.from_millis(_PATIENCE_MS)

    def _known_secret(self) -> str:
        """The one that nodes of this folder have in their names; "" if there is none, or only half of one."""
        try:
            text = self._secret.read_text("ascii", "replace")
        except FileNotFoundError:
            return ""
        except OSError as exc:
            raise TransportError(f"shm: {self._secret}: {exc.strerror}{hindrance(self._secret)}") from exc
        return text if _SECRET.fullmatch(text) else ""

    def _new_secret(self) -> str:
        secret = os.urandom(8).hex()
        try:
            self._secret.unlink(missing_ok=True)
            with open(os.open(self._secret, os.O_CREAT | os.O_EXCL | os.O_WRONLY | os.O_CLOEXEC, 0o600), "w") as file:
                file.write(secret)
        except OSError as exc:
            raise TransportError(f"shm: {self._secret}: {exc.strerror}{hindrance(self._secret)}") from exc
        return secret

    def _in_the_way(self) -> str:
        """What to do about another user's file with one of our names; "" if none is found."""
        try:
            ours = sorted(Path(SHARED_MEMORY).glob(f"{self._prefix}*"))
        except OSError:  # no descriptor is left, for example, which the caller reports
            return ""
        return next(filter(None, map(hindrance, ours)), "")

    def _clear(self) -> bool:
        """If no node is alive, remove what has no owner, and what iceoryx2 does not find of killed processes.

        Returns whether no node was alive. The caller holds the lock alone, so no other node can open meanwhile.
        """
        if self._known_secret() not in ("", self._own_secret):
            return False  # the folder was removed, and other processes are in a new one: we would not find them
        try:
            found = iceoryx2.Node.list(iceoryx2.ServiceType.Ipc, self._config)
        except _FAILURES:
            return False  # another node is leaving, and will look itself
        if not all(isinstance(each, iceoryx2.NodeState.Dead) for each in found):
            return False
        import shutil  # which takes longer than all else here, and is seldom needed

        self._sweep()
        shutil.rmtree(self._root, ignore_errors=True)
        with contextlib.suppress(OSError):  # it is another user's, which the next node to open reports
            self._secret.unlink(missing_ok=True)
        return True

    def bury(self) -> bool:
        """Remove what one killed process has left. Its samples and ports do not count any more.

        Returns whether others may have left something, too. iceoryx2 holds the interpreter meanwhile, 5 ms or more for
        each process, so the caller can do other things in between.
        """
        if self._node is None:
            return False
        if not self._dead:
            with contextlib.suppress(*_FAILURES):  # another one is doing so
                found = iceoryx2.Node.list(iceoryx2.ServiceType.Ipc, self._config)
                self._dead = [each[0] for each in found if isinstance(each, iceoryx2.NodeState.Dead)]
        if self._dead:
            with contextlib.suppress(*_FAILURES):
                self._dead.pop().try_remove_stale_resources()
        if not self._dead:
            remove_dead(self._prefix)
        return bool(self._dead)

    def new_queue(self, name: str, depth: int, share: int, writers: int, *, lossy: bool) -> Any:
        """One of which we are the reader. With `lossy`, one that is full gives up its oldest message."""
        check_room(OPENING)
        with as_transport_error(f"opening {name}"):
            service = _bytes(self._service(name)).enable_safe_overflow(lossy)
            service = service.max_subscribers(1).max_publishers(writers).max_nodes(writers + 1)
            service = service.subscriber_max_buffer_size(depth).subscriber_max_borrowed_samples(share)
            return service.history_size(0).create().subscriber_builder().create()

    def queue(self, name: str, loans: int) -> Any:
        """A port of another node, to which as many threads may write at once as there are `loans`."""
        check_room(OPENING)
        with as_transport_error(f"opening {name}"):
            service = _bytes(self._service(name)).open()
            limits = service.static_config
            samples = limits.subscriber_max_buffer_size + limits.subscriber_max_borrowed_samples + loans
            return _writer(service, samples)

    def new_topic(self, name: str, depth: int, history: int, share: int, borrowed: int, loans: int) -> tuple[Any, Any]:
        """The service, and the port by which we write to it. So many may be `borrowed` by all readers together."""
        check_room(OPENING)
        with as_transport_error(f"opening {name}"):
            service = _bytes(self._service(name)).enable_safe_overflow(True)
            service = service.max_subscribers(READERS).max_publishers(1).max_nodes(READERS + 1)
            service = service.subscriber_max_buffer_size(depth).subscriber_max_borrowed_samples(share)
            service = service.history_size(history).create()
            return service, _writer(service, depth + history + borrowed + loans + 1)

    def topic(self, name: str, missed: int) -> tuple[Any, Any] | None:
        """Another's service, and the port by which we read from it; None if its publisher has not opened it yet.

        `missed` is how much of its history we want.
        """
        check_room(OPENING)
        with as_transport_error(f"opening {name}"):
            try:
                service = _bytes(self._service(name)).open()
            except iceoryx2.PublishSubscribeOpenError as exc:
                if str(exc) == "DoesNotExist":
                    return None
                raise
            history: int = service.static_config.history_size
            return service, service.subscriber_builder().history_request(min(missed, history)).create()

    def _service(self, name: str) -> Any:
        if self._node is None:
            raise TransportError("shm: the transport is closed")
        return self._node.service_builder(iceoryx2.ServiceName.new(name))

    def _sweep(self) -> None:
        """Remove what processes left whose folder is gone, and with it the secret by which to find them.

        An array that is still over a sample keeps its memory: only the name goes.
        """
        with contextlib.suppress(OSError):  # no descriptor is left, for example: another time
            for left in Path(SHARED_MEMORY).glob(f"{self._family}*"):
                with contextlib.suppress(OSError):  # it is another user's
                    left.unlink()

    def _common(self) -> list[Path]:
        """What all nodes share, and none of them owns."""
        return list(Path(SHARED_MEMORY).glob(f"{self._prefix}*.global_mgmt"))


def _bytes(service: Any) -> Any:
    return service.publish_subscribe(OCTETS)


def _writer(service: Any, slots: int) -> Any:
    """Never one that waits for readers: iceoryx2 would do so in the middle of the interpreter, and stop it.

    All of its slots may be loaned at once, so that those that are free can be found.
    """
    port = service.publisher_builder().backpressure_strategy(iceoryx2.BackpressureStrategy.DiscardData)
    port = port.allocation_strategy(iceoryx2.AllocationStrategy.Static).initial_max_slice_len(SLOT_BYTES)
    return port.max_loaned_samples(slots).override_sample_preallocation(slots).create()


class _Lock:
    """Open nodes share it. A node that holds it alone may remove what has no owner.

    So nodes open and close beside each other, and only the first one to open and the last one to close make others
    wait. If a process opens or closes nodes while another holds the lock alone, it waits for that one.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._held = path, -1

    def take(self) -> bool:
        """Take it, alone if no other node is open; returns whether it is held alone. Raises TransportError."""
        end = time.monotonic() + _PATIENCE
        while not (alone := self._try(fcntl.LOCK_EX)) and not self._try(fcntl.LOCK_SH):
            self._pause(end)
        return alone

    def share(self) -> None:
        """Let other nodes take it, too. Raises TransportError."""
        end = time.monotonic() + _PATIENCE
        while not self._try(fcntl.LOCK_SH):  # the kernel gives it up first, so another node may take it alone
            self._pause(end)

    def is_last(self) -> bool:
        """Give it up, or hold it alone if no other node has it; returns whether it is held alone."""
        return self._try(fcntl.LOCK_EX)

    def release(self) -> None:
        """Give it back. Idempotent."""
        held, self._held = self._held, -1
        if held >= 0:
            fcntl.flock(held, fcntl.LOCK_UN)  # a forked child may have the descriptor, too
            os.close(held)

    def _try(self, how: int) -> bool:
        try:
            if self._held < 0:
                self._held = os.open(self._path, os.O_CREAT | os.O_RDWR | os.O_CLOEXEC, 0o600)
            fcntl.flock(self._held, how | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        except OSError as exc:
            raise TransportError(f"shm: {self._path}: {exc.strerror}{hindrance(self._path)}") from exc
        return True

    def _pause(self, end: float) -> None:
        if time.monotonic() >= end:
            raise TransportError(f"shm: {self._path} is locked, for {_PATIENCE:g} s")
        time.sleep(0.001)
