"""IceStorm as a program: whether one answers, and running it for components, as RoboComp's `rcnode` does.

Who starts components enters `hosted`. While nobody answers where they look for IceStorm, and that is an address of
this machine, an `icebox` with it is run here, and again if it dies, whoever ran it. Publishers and subscribers come
back to a new one by themselves (`exchange`). It remembers nothing (`IceStorm.Transient`), and its settings are on its
command line: there is no file to leave behind. The kernel ends it with the thread that started it, however that ends.
"""

from __future__ import annotations

import contextlib
import ctypes
import logging
import os
import re
import shutil
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from functools import partial

from ...errors import ConfigurationError, TransportError
from ...threads import NO_THREAD, start_thread
from ...wire.codec import MAX_BYTES
from ..directory import runtime_dir
from ..exclusive import Claim, holder, sweep, try_claim
from ..iceoptions import HOST, IceOptions, parse_proxy

log = logging.getLogger("robocomp.transport.ice")

START = 20.0
"""Seconds after which an icebox that has been started should answer."""

LOOK = 0.2
"""Seconds between two looks at our own icebox."""

CALL = 1.0
"""Seconds between two looks whether the IceStorm of somebody else answers, and that an answer may take."""

GRACE = 5.0
"""Seconds that it has to end, after which it is killed."""

LONGEST_PAUSE = 10.0
"""Seconds between two attempts to start one, when one after the other fails."""

QUEUE = 10_000
"""Messages that IceStorm keeps for a subscriber that is slow; then it drops some, which that one counts."""

HUNG_MS = 5000
"""A subscriber that takes nothing for so long is dropped, with what is kept for it. It comes back by itself."""

INSTALL = "Debian and Ubuntu have it: apt-get install zeroc-icebox libzeroc-icestorm3.7"

_PR_SET_PDEATHSIG = 1
_prctl = ctypes.PyDLL(None).prctl if sys.platform.startswith("linux") else lambda *arguments: -1


@contextlib.contextmanager
def hosted(options: IceOptions, owner: str) -> Iterator[None]:
    """While this is entered, IceStorm answers where `options` say, if that is a place of this machine.

    That it cannot be run is told, and no error: a network whose components only call each other needs none.
    """
    place = Place.of(options)
    if not place.is_here():
        yield
        return
    keeper = _Keeper(place, owner, options.message_size_max or MAX_BYTES)
    try:
        keeper.open()
        yield
    finally:
        keeper.close()


class Place:
    """Where an IceStorm is, or is to be."""

    def __init__(self, instance: str, host: str, port: int) -> None:
        self.instance, self.host, self.port = instance, host, port

    @classmethod
    def of(cls, options: IceOptions) -> Place:
        """Raises ConfigurationError if the options do not say it."""
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
        """Whether that is an address of this machine."""
        try:
            with socket.socket(socket.AF_INET6 if ":" in self.host else socket.AF_INET) as probe:
                probe.bind((self.host, 0))
        except OSError:
            return False
        return True

    def beside(self) -> int:
        """A port for publications that is free: the one before, as `rcnode` has it, or any."""
        for port in (self.port - 1, 0):
            try:
                with socket.socket(socket.AF_INET6 if ":" in self.host else socket.AF_INET) as probe:
                    probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                    probe.bind((self.host, port))
                    return int(probe.getsockname()[1])
            except OSError:
                continue
        return 0

    def answers(self, patience: float = CALL) -> bool:
        """Whether IceStorm is there: its TopicManager is asked, in Ice's protocol, whether it exists."""
        end = time.monotonic() + patience
        try:
            with socket.create_connection((self.host, self.port), patience) as connection:
                _receive(connection, end)  # that it is ready
                connection.sendall(_ping(self.instance, "TopicManager"))
                status = _receive(connection, end)[4:5]
        except (OSError, ValueError):
            return False
        return status == b"\0"


class _Keeper:
    """Runs an icebox while nobody else does."""

    def __init__(self, place: Place, owner: str, most_bytes: int) -> None:
        self._place, self._owner, self._most_bytes = place, owner or "ice", most_bytes
        self._beside = 0
        """The port of publications: that of the first IceStorm, as publishers that know no better go on with it."""
        self._thread = threading.Thread(target=self._keep, name="icestorm-keeper")
        self._ending, self._settled = threading.Event(), threading.Event()
        self._box: subprocess.Popen[bytes] | None = None
        self._claim: Claim | None = None
        self._started_at = self._not_before = self._pause = 0.0
        self._told = ""
        """Why it was not started at the last attempt."""

    def open(self) -> None:
        """Start it; returns once somebody's answers, or it is known why nobody's does."""
        if not start_thread(self._thread):
            raise TransportError(f"ice: IceStorm cannot be run: {NO_THREAD}")
        self._settled.wait(2 * START)

    def close(self) -> None:
        self._ending.set()
        if self._thread.ident is not None:
            self._thread.join()

    def _keep(self) -> None:
        """On a thread of its own, as the kernel ends the icebox when the thread that started it has ended."""
        try:
            while not self._ending.is_set():
                try:
                    pause = self._look()
                except Exception:  # if this thread ended, so would the icebox
                    log.exception("%s: looking after IceStorm; trying again", self._owner)
                    pause = CALL
                self._settled.set()
                self._ending.wait(pause)
        finally:
            self._stop()
            self._settled.set()

    def _look(self) -> float:
        """Do what is due; seconds until the next time."""
        if self._box:
            self._pass_on()
            if self._box.poll() is None:
                return LOOK
            self._mourn(self._box)
        if time.monotonic() < self._not_before or self._place.answers():
            return CALL
        self._start()
        return LOOK if self._box else CALL

    def _start(self) -> None:
        program = shutil.which("icebox")
        if program is None:
            self._complain(f"IceStorm does not answer at {self._place}, and there is no `icebox` to run it; {INSTALL}")
            return
        name = f"icestorm {self._place.host} {self._place.port}"
        claims = runtime_dir("ice", "storms")
        sweep(claims)
        self._claim = try_claim(claims, name, self._owner)
        if self._claim is None:
            who = holder(claims, name)
            self._complain(f"IceStorm does not answer at {self._place}; it is run by {who}")
            return
        try:
            self._box = self._launch(program)
        except (OSError, subprocess.SubprocessError) as exc:
            self._complain(f"IceStorm cannot be run at {self._place}: {program}: {exc}")
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
        if not self._ending.is_set() and not self._place.answers():  # else another one was quicker
            said = self._said() or f"it says nothing, for {START:g} s"
            lacks = f"; {INSTALL}" if "load" in said and "IceStormService" in said else ""
            self._complain(f"IceStorm cannot be run at {self._place}: {said}{lacks}")
        self._stop()

    def _launch(self, program: str) -> subprocess.Popen[bytes]:
        self._beside = self._beside or self._place.beside()
        return subprocess.Popen(
            _command(program, self._place, self._beside, self._most_bytes),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            env={key: value for key, value in os.environ.items() if key != "ICE_CONFIG"},
            start_new_session=True,  # Ctrl-C is for us; who needs it is ended first
            preexec_fn=partial(_die_with, os.getpid()),
        )

    def _mourn(self, box: subprocess.Popen[bytes]) -> None:
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
        self._put_off()

    def _stop(self) -> None:
        box, self._box = self._box, None
        if box:
            with box:  # which closes its pipe
                box.terminate()
                try:
                    box.wait(GRACE)
                except subprocess.TimeoutExpired:
                    box.kill()
        if self._claim:
            self._claim.close()
            self._claim = None

    def _complain(self, why: str) -> None:
        """Tell it, once, and try again later and later."""
        self._put_off()
        if why != self._told:
            self._told = why
            log.warning("%s: %s. Until there is one, nothing is published over ice", self._owner, why)

    def _put_off(self) -> None:
        """The first attempt after it has run for a while is made at once."""
        self._not_before = time.monotonic() + self._pause
        self._pause = min(2 * self._pause or CALL, LONGEST_PAUSE)

    def _said(self) -> str:
        """What it has written since we last looked, without the time of day."""
        assert self._box
        assert self._box.stderr
        said = (self._box.stderr.read() or b"").decode(errors="replace")
        return re.sub(r"^[-!]! \d\S* \d\S* ", "", said, flags=re.MULTILINE).strip()

    def _pass_on(self) -> None:
        for line in self._said().splitlines():
            log.warning("%s: icebox: %s", self._owner, line)


def _command(program: str, place: Place, beside: int, most_bytes: int) -> list[str]:
    host = rf"\"{place.host}\"" if ":" in place.host else place.host  # quoted inside of what is quoted below
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
    """By which the library with IceStorm is called: 37."""
    said = subprocess.run([program, "--version"], capture_output=True, text=True, timeout=START)
    found = re.search(r"(\d+)\.(\d+)", said.stdout + said.stderr)
    return "".join(found.groups()) if found else "37"


def _die_with(parent: int) -> None:
    """In the new process: have the kernel end it with its parent, or end now if that has ended already."""
    _prctl(_PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    if os.getppid() != parent:
        os._exit(1)


# -- as much of Ice's protocol as it takes to ask an object whether it exists ------------

_HEAD = struct.Struct("<4sBBBBBBi")
_REQUEST, _LONGEST = 0, 65536
_NO_ARGUMENTS = struct.pack("<iBB", 6, 1, 1)


def _ping(category: str, name: str) -> bytes:
    body = b"".join(
        (
            struct.pack("<i", 1),  # the number of the request
            _text(name),
            _text(category),
            b"\0",  # no facet
            _text("ice_ping"),
            b"\1\0",  # it may be repeated; no context
            _NO_ARGUMENTS,
        )
    )
    return _HEAD.pack(b"IceP", 1, 0, 1, 0, _REQUEST, 0, _HEAD.size + len(body)) + body


def _text(text: str) -> bytes:
    data = text.encode()
    return (bytes((len(data),)) if len(data) < 255 else b"\xff" + struct.pack("<i", len(data))) + data


def _receive(connection: socket.socket, end: float) -> bytes:
    """The body of one message; raises ValueError if it is none."""
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
