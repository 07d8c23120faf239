"""Runs IceStorm as a child process for components, as RoboComp's `rcnode` does, and checks whether one answers.

A program that starts components enters `hosted`. If the configured address of IceStorm belongs to this machine and no
IceStorm answers there, `hosted` runs an `icebox`, and does so again if the present one dies. Publishers and subscribers
reconnect to a new one automatically (`storm_client`).

The icebox stores nothing (`IceStorm.Transient`), and its settings are on its command line, so no file is left behind.
The kernel ends it together with the thread that started it.
"""

from __future__ import annotations

import contextlib
import logging
import os
import re
import shutil
import signal
import socket
import struct
import subprocess
import threading
import time
from collections.abc import Iterable, Iterator
from functools import partial

from ...errors import ConfigurationError, TransportError
from ...threads import NO_THREAD, start_thread
from ...wire.codec import MAX_BYTES
from ..exclusive import Claim, holder, sweep, try_claim
from ..iceoptions import HOST, IceOptions, parse_proxy
from ..runtime_folder import runtime_dir
from ..unsafe import end_with_parent

log = logging.getLogger("robocomp.transport.ice")

START = 20.0
"""Seconds that a started icebox has until it must answer."""

LOOK = 0.2
"""Seconds between two checks of our own icebox."""

CALL = 1.0
"""Seconds between two checks whether another IceStorm answers, and timeout of such a check."""

ASK = 0.5
"""Seconds in which an IceStorm tells which topics it has."""

GRACE = 5.0
"""Seconds that an icebox has to end before it is killed."""

LONGEST_PAUSE = 10.0
"""Maximum seconds between two attempts to start an icebox."""

QUEUE = 10_000
"""Messages that IceStorm keeps for a slow subscriber; further ones are dropped, and the subscriber counts them."""

HUNG_MS = 5000
"""IceStorm drops a subscriber that accepts nothing for this time, with its messages; it subscribes again."""

INSTALL = "Debian and Ubuntu have it: apt-get install zeroc-icebox libzeroc-icestorm3.7"


@contextlib.contextmanager
def hosted(options: IceOptions, owner: str) -> Iterator[None]:
    """Within this, IceStorm answers at the address in `options`, if that is an address of this machine.

    A failure to run it is only logged: components that only call each other do not need it.
    """
    place = Place.of(options)
    if not place.is_here():
        yield
        return
    keeper = _Supervisor(place, owner, options.message_size_max or MAX_BYTES)
    try:
        keeper.open()
        yield
    finally:
        keeper.close()


class Place:
    """The address of an IceStorm."""

    def __init__(self, instance: str, host: str, port: int) -> None:
        self.instance, self.host, self.port = instance, host, port

    @classmethod
    def of(cls, options: IceOptions) -> Place:
        """The address in the options. Raises ConfigurationError if it is invalid."""
        try:
            proxy = parse_proxy(options.storm)
        except ValueError as exc:
            raise ConfigurationError(f"transports.ice.storm: {exc}") from exc
        instance, _, name = proxy.identity.partition("/")
        if name != "TopicManager" or not proxy.endpoints:
            raise ConfigurationError(
                f"transports.ice.storm: {options.storm!r} is not like `IceStorm/TopicManager:tcp -h HOST -p PORT`"
            )
        first = proxy.endpoints[0]
        return cls(instance, first.host or options.host or HOST, first.port)

    def __str__(self) -> str:
        return f"{self.host}:{self.port}"

    def is_here(self) -> bool:
        """Whether it is an address of this machine."""
        try:
            with socket.socket(socket.AF_INET6 if ":" in self.host else socket.AF_INET) as probe:
                probe.bind((self.host, 0))
        except OSError:
            return False
        return True

    def beside(self) -> int:
        """A free port for publications: the previous number, which `rcnode` uses, or any."""
        for port in (self.port - 1, 0):
            try:
                with socket.socket(socket.AF_INET6 if ":" in self.host else socket.AF_INET) as probe:
                    probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                    probe.bind((self.host, port))
                    return int(probe.getsockname()[1])
            except OSError:
                continue
        return 0

    def answers(self, timeout: float = CALL) -> bool:
        """Whether IceStorm answers: this pings its TopicManager in Ice's protocol."""
        end = time.monotonic() + timeout
        try:
            with socket.create_connection((self.host, self.port), timeout) as connection:
                _receive(connection, end)  # the message that the connection is valid
                connection.sendall(_ping(self.instance, "TopicManager"))
                status = _receive(connection, end)[4:5]
        except (OSError, ValueError):
            return False
        return status == b"\0"

    def topics(self, names: Iterable[str], timeout: float = ASK) -> set[str]:
        """Those of these topics that IceStorm has; none if it does not answer within `timeout` seconds."""
        end = time.monotonic() + timeout
        found: set[str] = set()
        try:
            with socket.create_connection((self.host, self.port), timeout) as connection:
                _receive(connection, end)  # the message that the connection is valid
                for name in names:
                    connection.sendall(_request(self.instance, "TopicManager", "retrieve", _text(name)))
                    if _receive(connection, end)[4:5] == b"\0":  # else it raises NoSuchTopic
                        found.add(name)
        except (OSError, ValueError) as exc:
            log.debug("IceStorm at %s does not tell its topics: %s", self, exc)
            return set()
        return found


class _Supervisor:
    """Runs an icebox while no other program does."""

    def __init__(self, place: Place, owner: str, most_bytes: int) -> None:
        self._place, self._owner, self._most_bytes = place, owner or "ice", most_bytes
        self._beside = 0
        """The port of publications. A restarted icebox keeps it, because publishers go on using it."""
        self._thread = threading.Thread(target=self._run, name="icestorm-keeper", daemon=False)
        self._ending, self._settled = threading.Event(), threading.Event()
        self._box: subprocess.Popen[bytes] | None = None
        self._claim: Claim | None = None
        self._started_at = self._not_before = self._pause = 0.0
        self._told = ""
        """Why the last attempt to start it failed."""

    def open(self) -> None:
        """Start; returns when an IceStorm answers, or when it is known why none does."""
        if not start_thread(self._thread):
            raise TransportError(f"ice: IceStorm cannot be run: {NO_THREAD}")
        self._settled.wait(2 * START)

    def close(self) -> None:
        self._ending.set()
        if self._thread.ident is not None:
            self._thread.join()

    def _run(self) -> None:
        """Runs on its own thread: the kernel ends the icebox together with the thread that started it."""
        try:
            while not self._ending.is_set():
                try:
                    pause = self._look()
                except Exception:  # the end of this thread would end the icebox
                    log.exception("%s: checking IceStorm failed; trying again", self._owner)
                    pause = CALL
                self._settled.set()
                self._ending.wait(pause)
        finally:
            self._stop()
            self._settled.set()

    def _look(self) -> float:
        """Do what is due; returns the seconds until the next time."""
        if self._box:
            self._pass_on()
            if self._box.poll() is None:
                return LOOK
            self._report_end(self._box)
        if time.monotonic() < self._not_before or self._place.answers():
            return CALL
        self._start()
        return LOOK if self._box else CALL

    def _start(self) -> None:
        program = shutil.which("icebox")
        if program is None:
            self._report(f"IceStorm does not answer at {self._place}, and there is no `icebox` to run it; {INSTALL}")
            return
        name = f"icestorm {self._place.host} {self._place.port}"
        claims = runtime_dir("ice", "storms")
        sweep(claims)
        self._claim = try_claim(claims, name, self._owner)
        if self._claim is None:
            owner = holder(claims, name)
            self._report(f"IceStorm does not answer at {self._place}; it is run by {owner}")
            return
        try:
            self._box = self._launch(program)
        except (OSError, subprocess.SubprocessError) as exc:
            self._report(f"IceStorm cannot be run at {self._place}: {program}: {exc}")
            self._stop()
            return
        assert self._box.stderr
        os.set_blocking(self._box.stderr.fileno(), False)
        end = time.monotonic() + START
        while not self._ending.is_set() and time.monotonic() < end:
            if self._place.answers():
                log.info("%s: IceStorm runs at %s (pid %d)", self._owner, self._place, self._box.pid)
                self._told, self._started_at = "", time.monotonic()
                return
            if self._box.poll() is not None:
                break
            self._ending.wait(0.01)
        if not self._ending.is_set() and not self._place.answers():  # otherwise another program has started one
            output = self._output() or f"it says nothing, for {START:g} s"
            lacks = f"; {INSTALL}" if "load" in output and "IceStormService" in output else ""
            self._report(f"IceStorm cannot be run at {self._place}: {output}{lacks}")
        self._stop()

    def _launch(self, program: str) -> subprocess.Popen[bytes]:
        self._beside = self._beside or self._place.beside()
        return subprocess.Popen(
            _command(program, self._place, self._beside, self._most_bytes),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            env={key: value for key, value in os.environ.items() if key != "ICE_CONFIG"},
            start_new_session=True,  # Ctrl-C must not end it before the components
            preexec_fn=partial(_die_with, os.getpid()),
        )

    def _report_end(self, box: subprocess.Popen[bytes]) -> None:
        code = box.returncode
        how = f"was killed by {signal.Signals(-code).name}" if code < 0 else f"ended with exit status {code}"
        log.error(
            "%s: IceStorm at %s (pid %d) %s; starting it again: what was published meanwhile is lost",
            self._owner,
            self._place,
            box.pid,
            how,
        )
        self._stop()
        if time.monotonic() - self._started_at >= LONGEST_PAUSE:
            self._pause = 0.0
        self._lengthen_pause()

    def _stop(self) -> None:
        box, self._box = self._box, None
        if box:
            with box:  # closes its pipe
                box.terminate()
                try:
                    box.wait(GRACE)
                except subprocess.TimeoutExpired:
                    box.kill()
        if self._claim:
            self._claim.close()
            self._claim = None

    def _report(self, why: str) -> None:
        """Log a problem, once, and lengthen the pause before the next attempt."""
        self._lengthen_pause()
        if why != self._told:
            self._told = why
            log.warning("%s: %s. Until one does, publications over ice fail", self._owner, why)

    def _lengthen_pause(self) -> None:
        """Lengthen the pause before the next attempt; after a long run, the first attempt is immediate."""
        self._not_before = time.monotonic() + self._pause
        self._pause = min(2 * self._pause or CALL, LONGEST_PAUSE)

    def _output(self) -> str:
        """The icebox's new output, without the time of day."""
        assert self._box
        assert self._box.stderr
        output = (self._box.stderr.read() or b"").decode(errors="replace")
        return re.sub(r"^[-!]! \d\S* \d\S* ", "", output, flags=re.MULTILINE).strip()

    def _pass_on(self) -> None:
        for line in self._output().splitlines():
            log.warning("%s: icebox: %s", self._owner, line)


def _command(program: str, place: Place, beside: int, most_bytes: int) -> list[str]:
    host = rf"\"{place.host}\"" if ":" in place.host else place.host  # within the quotes below
    at = f"tcp -h {host}"
    settings = {
        "IceStorm.InstanceName": place.instance,
        "IceStorm.TopicManager.Endpoints": f"{at} -p {place.port}",
        "IceStorm.Publish.Endpoints": f"{at} -p {beside}",
        "IceStorm.Transient": 1,
        "IceStorm.Send.Timeout": HUNG_MS,
        "IceStorm.Send.QueueSizeMax": QUEUE,
        "IceStorm.Send.QueueSizeMaxPolicy": "DropEvents",
        "Ice.MessageSizeMax": most_bytes // 1024 + 1024,
        "Ice.Warn.Connections": 0,
    }
    options = " ".join(f'"--{name}={value}"' for name, value in settings.items())
    service = f"IceStormService,{_version(program)}:createIceStorm {options}"
    return [program, f"--IceBox.Service.IceStorm={service}"]


def _version(program: str) -> str:
    """The version in the name of IceStorm's library: 37."""
    output = subprocess.run([program, "--version"], capture_output=True, text=True, timeout=START)
    found = re.search(r"(\d+)\.(\d+)", output.stdout + output.stderr)
    return "".join(found.groups()) if found else "37"


def _die_with(parent: int) -> None:
    """In the child: have the kernel end it with its parent, or end now if the parent has ended."""
    end_with_parent()
    if os.getppid() != parent:
        os._exit(1)


# -- as much of Ice's protocol as it takes to ask IceStorm whether it is there, and has a topic ------------

_HEAD = struct.Struct("<4sBBBBBBi")
_REQUEST, _LONGEST = 0, 65536


def _ping(category: str, name: str) -> bytes:
    return _request(category, name, "ice_ping")


def _request(category: str, name: str, operation: str, arguments: bytes = b"") -> bytes:
    body = b"".join(
        (
            struct.pack("<i", 1),  # the number of the request
            _text(name),
            _text(category),
            b"\0",  # no facet
            _text(operation),
            b"\1\0",  # idempotent; no context
            struct.pack("<iBB", 6 + len(arguments), 1, 1),
            arguments,
        )
    )
    return _HEAD.pack(b"IceP", 1, 0, 1, 0, _REQUEST, 0, _HEAD.size + len(body)) + body


def _text(text: str) -> bytes:
    data = text.encode()
    return (bytes((len(data),)) if len(data) < 255 else b"\xff" + struct.pack("<i", len(data))) + data


def _receive(connection: socket.socket, end: float) -> bytes:
    """The body of one message. Raises ValueError if it is not one of Ice's."""
    magic, *_, size = _HEAD.unpack(_read(connection, _HEAD.size, end))
    if magic != b"IceP" or not _HEAD.size <= size <= _LONGEST:
        raise ValueError("this is not Ice")
    return _read(connection, size - _HEAD.size, end)


def _read(connection: socket.socket, size: int, end: float) -> bytes:
    data = b""
    while len(data) < size:
        connection.settimeout(max(0.001, end - time.monotonic()))
        more = connection.recv(size - len(data))
        if not more:
            raise ValueError("the connection was closed")
        data += more
    return data
