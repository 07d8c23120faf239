"""iceoryx2, and nothing else of ours knows it: who is here, and the ports through which samples pass.

    a queue     one reads, several write; what finds no room in it is not taken
    a topic     one writes, several read; who is slow loses the oldest

What iceoryx2 keeps in files is below a folder of the user's own, and what it keeps in shared memory has
names that begin with a prefix made of that folder: users, and run-time folders, do not meet. What killed
processes have left there is removed by the next node.
"""

from __future__ import annotations

import contextlib
import ctypes
import fcntl
import hashlib
import os
import resource
import shutil
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import iceoryx2

from ...errors import ConfigurationError, TransportError

PORTS = 512
"""So many may write to one queue: other transports of this host, and threads of theirs."""

READERS = 128
"""So many may read one topic."""

OPENING = 8 * 1024 * 1024
"""Bytes of shared memory that must be free when something is opened. It takes a small part of that."""

SHARED_MEMORY = "/dev/shm"

FIRST_BYTES = 4096
"""Size of the samples that a port begins with; it grows by powers of two."""

_LONGEST_FOLDER = 100
"""Bytes in the path of a run-time folder: iceoryx2 adds up to 140 to it, and panics beyond 255."""

_FILES = 32
"""So many files may be opened at once, by what fails for want of them, and then closes what it has opened."""

_PATIENCE = 5.0
"""Seconds for which we wait for those who enter or leave just now."""

_PATIENCE_MS = 500
"""How long iceoryx2 waits for somebody who is about to create something, and the interpreter with it."""

_FAILURES = tuple(each for each in vars(iceoryx2).values() if isinstance(each, type) and issubclass(each, Exception))

iceoryx2.set_log_level_from_env_or(iceoryx2.LogLevel.Fatal)  # what fails is said by us, once, to whom it concerns


@contextlib.contextmanager
def as_transport_error(doing: str) -> Iterator[None]:
    try:
        yield
    except _FAILURES as exc:
        raise TransportError(f"shm: {doing}: {exc}{what_is_short()}") from exc


def what_is_short() -> str:
    """What iceoryx2 calls an internal failure, and can be mended."""
    limit, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    try:
        used = len(os.listdir("/proc/self/fd"))
    except OSError:  # not even this one
        used = limit
    if used + _FILES < limit:
        return ""
    return f"; this process has {used} files open, and may have {limit}: let it have more (ulimit -n 4096)"


def prefix(folder: Path) -> str:
    """What the names of all that is in shared memory begin with, for a folder and its user."""
    return "rc" + hashlib.sha256(f"{os.getuid()}:{folder.resolve()}".encode()).hexdigest()[:8] + "_"


class Node:
    """This process, or one of its transports, as iceoryx2 sees it. Names are unique among all nodes of the folder."""

    def __init__(self, folder: Path) -> None:
        self.folder, self._root = folder, folder / "i"
        self._prefix = prefix(folder)
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
        config = iceoryx2.config.default()
        settings = config.global_cfg
        settings.root_path = iceoryx2.Path.new(str(self._root))
        settings.prefix = iceoryx2.FileName.new(self._prefix)
        settings.creation_timeout = iceoryx2.Duration.from_millis(_PATIENCE_MS)
        builder = iceoryx2.NodeBuilder.new().config(config)
        builder = builder.signal_handling_mode(iceoryx2.SignalHandlingMode.Disabled)  # signals are Python's business
        self._lock = _Lock(folder / "nodes.lock")
        with self._lock.taken(), as_transport_error("opening a node"):
            self._config = config
            self._clear()
            self._node: Any = builder.create(iceoryx2.ServiceType.Ipc)
            for shared in self._common():
                shared.chmod(0o600)

    def close(self) -> None:
        """Leave. Idempotent. What is still in use, as a sample is by an array over it, goes when that does."""
        if not self._root.exists():  # somebody has removed the folder
            self._node = None
            return
        with self._lock.taken():
            self._node = None
            self._clear()

    def _clear(self) -> None:
        """If nobody is here, remove what nobody owns, and what iceoryx2 does not find of those who were killed.

        For whoever holds the lock: nobody else can come meanwhile.
        """
        try:
            found = iceoryx2.Node.list(iceoryx2.ServiceType.Ipc, self._config)
        except _FAILURES:
            return  # somebody is leaving, who will look himself
        if all(isinstance(each, iceoryx2.NodeState.Dead) for each in found):
            self._sweep()
            shutil.rmtree(self._root, ignore_errors=True)

    def bury(self) -> None:
        """Remove what killed processes have left. Their samples and ports do not count any more."""
        if self._node is not None:
            with contextlib.suppress(*_FAILURES):  # another one is doing so
                self._node.try_cleanup_dead_nodes()

    def new_queue(self, name: str, depth: int, share: int, writers: int, *, lossy: bool) -> Any:
        """One of which we are the reader. With `lossy`, one that is full gives up its oldest message."""
        check_room(OPENING)
        with as_transport_error(f"opening {name}"):
            service = _bytes(self._service(name)).enable_safe_overflow(lossy)
            service = service.max_subscribers(1).max_publishers(writers).max_nodes(writers + 1)
            service = service.subscriber_max_buffer_size(depth).subscriber_max_borrowed_samples(share)
            return service.history_size(0).create().subscriber_builder().create()

    def queue(self, name: str, loans: int) -> Any:
        """Another's, to write to."""
        check_room(OPENING)
        with as_transport_error(f"opening {name}"):
            service = _bytes(self._service(name)).open()
            limits = service.static_config
            samples = limits.subscriber_max_buffer_size + limits.subscriber_max_borrowed_samples + loans
            return _writer(service, loans, samples)

    def new_topic(self, name: str, depth: int, history: int, share: int, borrowed: int, loans: int) -> tuple[Any, Any]:
        """The service, and the port by which we write to it. So many may be `borrowed` by all readers together."""
        check_room(OPENING)
        with as_transport_error(f"opening {name}"):
            service = _bytes(self._service(name)).enable_safe_overflow(True)
            service = service.max_subscribers(READERS).max_publishers(1).max_nodes(READERS + 1)
            service = service.subscriber_max_buffer_size(depth).subscriber_max_borrowed_samples(share)
            service = service.history_size(history).create()
            return service, _writer(service, loans, depth + history + borrowed + loans + 1)

    def topic(self, name: str, missed: int) -> tuple[Any, Any]:
        """Another's service, and the port by which we read from it; `missed` is how much of its history we want."""
        check_room(OPENING)
        with as_transport_error(f"opening {name}"):
            service = _bytes(self._service(name)).open()
            history: int = service.static_config.history_size
            return service, service.subscriber_builder().history_request(min(missed, history)).create()

    def _service(self, name: str) -> Any:
        if self._node is None:
            raise TransportError("shm: the transport is closed")
        return self._node.service_builder(iceoryx2.ServiceName.new(name))

    def _sweep(self) -> None:
        """Remove what was left by processes whose folder is gone, and with it what iceoryx2 would find them by.

        An array that is still over a sample keeps its memory: only the name goes.
        """
        for left in Path(SHARED_MEMORY).glob(f"{self._prefix}*"):
            with contextlib.suppress(OSError):  # another time
                left.unlink()

    def _common(self) -> list[Path]:
        """What all nodes share, and none of them owns."""
        return list(Path(SHARED_MEMORY).glob(f"{self._prefix}*.global_mgmt"))


def _bytes(service: Any) -> Any:
    return service.publish_subscribe(iceoryx2.Slice[ctypes.c_uint8])


def _writer(service: Any, loans: int, samples: int) -> Any:
    """Never one that waits for readers: iceoryx2 would do so in the middle of the interpreter, and stop it."""
    port = service.publisher_builder().backpressure_strategy(iceoryx2.BackpressureStrategy.DiscardData)
    port = port.allocation_strategy(iceoryx2.AllocationStrategy.PowerOfTwo).initial_max_slice_len(FIRST_BYTES)
    return port.max_loaned_samples(loans).override_sample_preallocation(samples).create()


def check_room(size: int) -> None:
    """Raise TransportError if there is not so much shared memory left: who writes to more than there is, is killed."""
    left = free()
    if left < size:
        raise full(size, left)


def free() -> int:
    """Bytes of shared memory that are left."""
    try:
        found = os.statvfs(SHARED_MEMORY)
    except OSError as exc:
        raise TransportError(f"shm: {SHARED_MEMORY}: {exc.strerror}") from exc
    return found.f_bavail * found.f_frsize


def full(size: int, left: int) -> TransportError:
    return TransportError(
        f"shm: {size} bytes of shared memory are needed, and {left} are left in {SHARED_MEMORY}; make it larger "
        f"(mount -o remount,size=2G {SHARED_MEMORY}; for a container, --shm-size=2g), or choose another middleware"
    )


class _Lock:
    """Who enters or leaves does so alone: the last one removes what nobody owns."""

    def __init__(self, path: Path) -> None:
        self._path = path

    @contextlib.contextmanager
    def taken(self) -> Iterator[None]:
        try:
            held = os.open(self._path, os.O_CREAT | os.O_RDWR | os.O_CLOEXEC, 0o600)
        except OSError as exc:
            raise TransportError(f"shm: {self._path}: {exc.strerror}") from exc
        try:
            end = time.monotonic() + _PATIENCE
            while True:
                try:
                    fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    break
                except BlockingIOError:
                    if time.monotonic() >= end:
                        raise TransportError(f"shm: {self._path} is locked, for {_PATIENCE:g} s") from None
                    time.sleep(0.001)
            yield
        finally:
            os.close(held)
