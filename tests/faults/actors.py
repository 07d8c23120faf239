"""The processes to which things are done: servers, clients, publishers and subscribers over one transport.

    python -m tests.faults.actors     forks an actor for each line that it is given, and loads nothing twice

An actor does what it is asked on its control socket, a JSON object a line, and ends when that is closed. What happens
it writes to its journal, not to the socket: so it is there after `kill -9`.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import logging
import os
import random
import resource
import signal
import socket
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from robocomp_py.contract.qos import QoS, Reliability
from robocomp_py.errors import DecodeError, RobocompError, TransportError
from robocomp_py.runtime.retries import Retrying
from robocomp_py.testing.parts import BLOB, blob, command, query, topic, unblob
from robocomp_py.transports.base import (
    Caller,
    Channel,
    Outlet,
    Reply,
    Statistics,
    Status,
    TransportConfig,
    TypeRef,
    find_transport,
)
from robocomp_py.wire.codec import MAX_BYTES, Payload
from robocomp_py.wire.header import pack_request

from ..strangers import attack
from .fuzzers import fuzz
from .history import Asked, Counted, Ended, Executed, Heard, Journal, Published
from .members import Herald, Living

_END = b"|"
"""Of what a message says; what follows makes it as large as it is to be."""

_STUCK = 60.0
"""Seconds after which work that was told to end is said to hang."""


class Actor:
    def __init__(self, name: str, transport: str, options: Mapping[str, Any], journal: Path) -> None:
        self.name, self.journal, self.middleware = name, Journal(journal), transport
        self.transport = find_transport(transport)(TransportConfig(dict(options), owner=name))
        self._links: dict[str, Any] = {}
        self._work: dict[str, threading.Thread] = {}
        self._stop: dict[str, threading.Event] = {}
        self._said: dict[str, Any] = {}
        self._published = 0
        self._hoard: list[int] = []
        self._living: dict[str, Living] = {}
        self._well: Counter[str] = Counter()
        self._numbers = itertools.count(1)
        self._now = self._most = 0
        """Bytes that are held, and their maximum since the last request."""

    # Servers.

    def serve(self, channel: str, pause: float = 0.0, idempotent: bool = False, later: bool = False) -> None:
        """Answer with our name, after `pause` seconds; `later` by another thread, so that many are served at once."""

        def service(payload: Payload, expires: float) -> Reply | Future[Reply]:
            try:
                self._note_executed(payload)
            except DecodeError:
                return Reply(Status.FAILED)
            reply = Reply(Status.OK, blob(self.transport, self.name.encode()))
            if not later:
                if pause:
                    time.sleep(pause)
                return reply
            promise: Future[Reply] = Future()
            threading.Timer(pause, promise.set_result, [reply]).start()
            return promise

        self._links[channel] = self.transport.server(_query(channel, idempotent), service)

    def take(self, channel: str, pause: float = 0.0) -> None:
        def sink(payload: Payload) -> None:
            with contextlib.suppress(DecodeError):
                self._note_executed(payload)
            if pause:
                time.sleep(pause)

        self._links[channel] = self.transport.inlet(command(channel), sink)

    # Clients.

    def ask(
        self,
        channel: str,
        calls: int,
        deadline: float = 5.0,
        pace: float = 0.005,
        idempotent: bool = False,
        how: str = "ask",
        size: int = 0,
    ) -> None:
        """Call again and again, until told to stop, at most so many times."""
        caller: Caller = self.transport.caller(_query(channel, idempotent))
        if idempotent:
            caller = Retrying(caller)
        self._links[channel] = caller
        kind = "idempotent" if idempotent else "query"

        def ask(call: str) -> tuple[str, str]:
            payload = _message(self.transport, call, size)
            reply = caller.ask(payload, deadline) if how == "ask" else caller.call(payload, deadline).result(_STUCK)
            server = unblob(self.transport, reply.payload).decode() if reply.status is Status.OK else ""
            return reply.status.name.lower(), server

        self._repeat(channel, calls, pace, kind, deadline, ask)

    def command(self, channel: str, calls: int, deadline: float = 5.0, pace: float = 0.0, size: int = 0) -> None:
        outlet: Outlet = self._links.get(channel) or self.transport.outlet(command(channel))
        self._links[channel] = outlet

        def send(call: str) -> tuple[str, str]:
            outlet.send(_message(self.transport, call, size), deadline)
            return "ok", ""

        self._repeat(channel, calls, pace, "command", deadline, send)

    def _repeat(
        self,
        channel: str,
        calls: int,
        pace: float,
        kind: str,
        deadline: float,
        do: Callable[[str], tuple[str, str]],
    ) -> None:
        def work(stop: threading.Event) -> int:
            number = 0
            while number < calls and not stop.is_set():
                number += 1
                call = f"{self.name}.{channel}.{next(self._numbers)}"
                self.journal.note(Asked(call, kind, deadline, time.monotonic()))
                try:
                    outcome, server = do(call)
                    self._well[channel] += outcome == "ok"
                except TransportError as exc:
                    outcome, server = type(exc).__name__, ""
                self.journal.note(Ended(call, outcome, time.monotonic(), server))
                stop.wait(pace)
            return number

        self._begin(channel, work)

    def well(self, channel: str) -> int:
        """How many calls or commands ended well."""
        return self._well[channel]

    # Topics.

    def publish(
        self, channel: str, count: int, pace: float = 0.0, size: int = 0, reliable: bool = False, depth: int = 8
    ) -> None:
        """Publish so many, or until told to stop; what each took is said at the end, in seconds, sorted."""
        outlet: Outlet = self._links.get(channel) or self.transport.outlet(topic(channel, _qos(reliable, depth)))
        self._links[channel] = outlet

        def work(stop: threading.Event) -> dict[str, Any]:
            taken: list[float] = []
            while len(taken) < count and not stop.is_set():
                number = self._published = self._published + 1
                payload = _message(self.transport, f"{self.name} {number}", size)
                self.journal.note(Published(self.name, number))
                begun = time.monotonic()
                outlet.send(payload)
                taken.append(time.monotonic() - begun)
                if pace:
                    stop.wait(pace)
            taken.sort()
            return {"p99": taken[int(len(taken) * 0.99)], "worst": taken[-1]} if taken else {}

        self._begin(channel, work)

    def sent(self) -> int:
        """How many messages were published."""
        return self._published

    def subscribe(
        self, channel: str, pause: float = 0.0, depth: int = 8, reliable: bool = False, tap: bool = False
    ) -> None:
        def sink(payload: Payload) -> None:
            source, _, number = _said(self.transport, payload).partition(" ")
            self.journal.note(Heard(self.name, source, int(number)))
            if pause:
                time.sleep(pause)

        asked = replace(topic(channel, _qos(reliable, depth)), tap=tap)
        self._links[channel] = self.transport.inlet(asked, sink)

    def subscribe_other(self, channel: str) -> None:
        """Mean something else by that name."""
        other = replace(topic(channel), type=TypeRef("Conformance::Blob", 2, _OTHER))
        self._links[channel] = self.transport.inlet(other, lambda _: self.journal.note(Heard(self.name, "?", 1)))

    # Memory.

    def keep(self, channel: str, places: int, seed: int) -> None:
        """Answer, obey and listen, and keep some of what comes; each new message takes a place, or none, at random.

        An answer has as many octets as its request says, and begins with how many messages were taken before.
        """
        chance, decode, taken = random.Random(seed), self.transport.codec.decoder(BLOB), itertools.count(1)
        lock = threading.Lock()
        self._kept = kept = dict[int, Any]()

        def take(payload: Payload) -> tuple[int, int]:
            (array,) = decode(payload)
            with lock:
                place = chance.randrange(2 * places)
                if place < places:
                    kept[place] = array
                self._hold(sum(each.nbytes for each in list(kept.values())))
                return next(taken), int(array.tobytes().partition(_END)[0] or 0)

        def service(payload: Payload, expires: float) -> Reply:
            number, size = take(payload)
            return Reply(Status.OK, _message(self.transport, str(number), size))

        self._links[f"{channel}q"] = self.transport.server(query(f"{channel}q"), service)
        self._links[f"{channel}c"] = self.transport.inlet(command(f"{channel}c"), take)
        self._links[f"{channel}t"] = self.transport.inlet(topic(f"{channel}t", _qos(reliable=True)), take)

    def keep_nothing(self) -> None:
        self._kept.clear()

    def mix(self, channel: str, seconds: float, most: int, seed: int) -> None:
        """Ask, command and publish messages of random sizes to one that keeps some, and wait until they were taken."""
        chance = random.Random(seed)
        asked = self.transport.caller(query(f"{channel}q"))
        told = self.transport.outlet(command(f"{channel}c"))
        said = self.transport.outlet(topic(f"{channel}t", _qos(reliable=True)))
        self._links.update({f"{channel}q": asked, f"{channel}c": told, f"{channel}t": said})
        if not all(link.wait_peer(20.0) for link in (asked, told, said)):
            raise RobocompError(f"{self.name}: nobody keeps what comes")

        def ask(size: int, answer: int) -> int:
            self._hold(size + answer, more=True)
            reply = asked.ask(_message(self.transport, str(answer), size), 20.0)
            return int(_said(self.transport, reply.payload))

        def work(stop: threading.Event) -> dict[str, int]:
            end = time.monotonic() + seconds
            sent = failed = 0
            while time.monotonic() < end and not stop.is_set():
                self._hold(0)
                try:
                    for _ in range(chance.randrange(4)):
                        size = int(most * chance.random() ** 4)
                        self._hold(size, more=True)
                        chance.choice((told, said)).send(_message(self.transport, "0", size), 20.0)
                        sent += 1
                    size, answer = (int(most * chance.random() ** 4) for _ in range(2))
                    sent += 1
                    while ask(size, answer) < sent:
                        size = answer = 0
                        sent += 1
                except TransportError as exc:
                    logging.getLogger("actor").error("%s: %s", self.name, exc)
                    failed += 1
            self._hold(0)
            return {"sent": sent, "failed": failed}

        self._begin(channel, work)

    def _hold(self, size: int, *, more: bool = False) -> None:
        self._now = self._now + size if more else size
        self._most = max(self._most, self._now)

    def held(self) -> int:
        """The most bytes that were kept here, or sent and not known to be taken, since this was asked before."""
        most, self._most = self._most, self._now
        return most

    # Components.

    def live(
        self,
        kind: str,
        name: str,
        source: str = "",
        patient: bool = True,
        options: Mapping[str, Any] | None = None,
        qos: str = "",
    ) -> None:
        """Run a component of that kind, whose server is `source`; if `patient`, wait until it is ready."""
        self._living[name] = Living(kind, name, source, self.middleware, self.journal, options or {}, qos)
        if patient:
            self._living[name].wait_until_ready()

    def leave(self, name: str) -> None:
        """Have a component of ours end, and wait for it."""
        self._living.pop(name).close()

    def is_up(self, name: str) -> bool:
        return self._living[name].is_up

    def demand(self, name: str, number: int) -> None:
        """Have a reader of ours command and ask its herald to publish this number."""
        self._living[name].worker.number = number

    def proclaim(self, name: str, number: int) -> None:
        """Have a herald of ours publish this number."""
        self._living[name].worker.publish(number, "ready")

    def news(self, name: str) -> list[tuple[int, str]]:
        """What a herald of ours has published, or a reader of ours heard."""
        worker = self._living[name].worker
        return list(worker.published if isinstance(worker, Herald) else worker.heard)

    def begin(self) -> None:
        """Have our clients ask."""
        for each in self._living.values():
            each.worker.asks.set()

    def cease(self) -> None:
        """Have our clients ask no more, and wait for their answers."""
        for each in self._living.values():
            each.worker.asks.clear()

    def outcomes(self) -> dict[str, dict[str, int]]:
        """Of each client of ours, how many calls ended how."""
        return {name: dict(each.worker.outcomes) for name, each in self._living.items()}

    def heard(self, name: str) -> int:
        """How many messages a relay has heard."""
        return int(self._living[name].worker.heard)

    # Others.

    def fuzz(self, channel: str, commands: str, seed: int, count: int) -> None:
        """Send what is no message; `wait` tells how many seconds that took."""
        caller = self.transport.caller(query(channel))
        caller.wait_peer(10.0)

        def work(stop: threading.Event) -> float:
            begun = time.monotonic()
            fuzz(self.transport, self.middleware, channel, commands, seed, count)
            return time.monotonic() - begun

        self._begin("fuzz", work)

    def limit_files(self, count: int) -> None:
        """Have this process run out of descriptors early."""
        resource.setrlimit(resource.RLIMIT_NOFILE, (count, count))

    def attack(self, what: str, channel: str, seconds: float) -> None:
        """Take more than our share of the server or publisher of a channel, as `strangers.attack` does."""
        role = "publishes" if what == "subscriptions" else "serves"
        end = time.monotonic() + _STUCK
        while not (found := self.transport.directory.find(role, channel)):  # type: ignore[attr-defined]  # zeromq's
            if time.monotonic() > end:
                raise TransportError(f"{channel}: nobody {role} it")
            time.sleep(0.05)
        port = int(found[0][1].address.rpartition(":")[2].partition("#")[0])
        header = pack_request(0, query(channel).type.fingerprint, 7, 1, 5.0)
        os.nice(19)  # it stands for a program on another host, which takes no processor time from this one
        self._begin("attack", lambda _: attack(what, port, seconds, channel.encode() + b"\0" + header))

    def ask_too_much(self, channel: str) -> str:
        """What comes of a call whose payload is larger than any may be."""
        try:
            self._links[channel].ask(blob(self.transport, bytes(MAX_BYTES + 1)), 30.0)
        except RobocompError as exc:
            return f"{type(exc).__name__}: {exc}"
        return "ok"

    def ask_once(self, channel: str) -> str:
        """Who answers."""
        call = f"{self.name}.once"
        self.journal.note(Asked(call, "query", 10.0, time.monotonic()))
        reply = self._links[channel].ask(_message(self.transport, call, 0), 10.0)
        server = unblob(self.transport, reply.payload).decode()
        self.journal.note(Ended(call, "ok", time.monotonic(), server))
        return server

    # About all of them.

    def stats(self, channel: str, count: bool = False) -> dict[str, int]:
        """What a link counted; with `count`, what it lost is part of the history."""
        stats: Statistics = self._links[channel].stats
        if count:
            self.journal.note(Counted(self.name, stats.lost + stats.dropped + stats.expired + stats.malformed))
        return asdict(stats)

    def hoard(self, spare: int) -> None:
        """Open files until there are no more descriptors left than `spare`."""
        _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
        resource.setrlimit(resource.RLIMIT_NOFILE, (max(map(int, os.listdir("/proc/self/fd"))) + 20, most))
        with contextlib.suppress(OSError):
            while True:
                self._hoard.append(os.open(os.devnull, os.O_RDONLY))
        for _ in range(spare):
            os.close(self._hoard.pop())

    def release(self) -> None:
        """Close what was hoarded."""
        _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
        while self._hoard:
            os.close(self._hoard.pop())
        resource.setrlimit(resource.RLIMIT_NOFILE, (min(most, 4096), most))

    def clock(self) -> float:
        return time.time()

    def usage(self) -> dict[str, int]:
        status = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines())
        return {
            "threads": int(status["Threads"]),
            "files": len(os.listdir("/proc/self/fd")) - 1,
            "memory": int(status["VmRSS"].split()[0]) * 1024,
            "peak": int(status["VmHWM"].split()[0]) * 1024,
        }

    def stop(self, channel: str) -> Any:
        """Have work end, and wait for it; what it said."""
        self._stop[channel].set()
        return self.wait(channel)

    def wait(self, channel: str, timeout: float = _STUCK) -> Any:
        self._work[channel].join(timeout)
        if self._work[channel].is_alive():
            raise RobocompError(f"{self.name}: {channel} hangs")
        said = self._said[channel]
        if isinstance(said, BaseException):
            raise RobocompError(f"{self.name}: {channel}: {said!r}")
        return said

    def close(self) -> None:
        for stop in self._stop.values():
            stop.set()
        for each in self._living.values():
            each.close()
        self.transport.close()

    def _begin(self, channel: str, work: Callable[[threading.Event], Any]) -> None:
        stop = self._stop[channel] = threading.Event()

        def run() -> None:
            try:
                self._said[channel] = work(stop)
            except BaseException as exc:  # told to who waits
                self._said[channel] = exc

        self._work[channel] = threading.Thread(target=run, name=f"work-{channel}")
        self._work[channel].start()

    def _note_executed(self, payload: Payload) -> None:
        said = _said(self.transport, payload)
        self.journal.note(Executed(said, self.name, time.monotonic()))


_OTHER = "operation Conformance::Blob.send\nstruct Conformance::Blob\n  data sequence<int16>"


def _query(channel: str, idempotent: bool) -> Channel:
    return replace(query(channel), idempotent=idempotent)


def _qos(reliable: bool, depth: int = 8) -> QoS:
    return QoS(Reliability.RELIABLE if reliable else Reliability.BEST_EFFORT, depth=depth)


def _message(transport: Any, text: str, size: int) -> Payload:
    return blob(transport, (text.encode() + _END).ljust(size, b"."))


def _said(transport: Any, payload: Payload) -> str:
    return unblob(transport, payload).partition(_END)[0].decode(errors="replace")


# -- processes ----------------------------------------------------------------


def act(spec: Mapping[str, Any]) -> None:
    """Carry out requests until the connection ends."""
    log = logging.FileHandler(spec["log"])
    log.setFormatter(logging.Formatter("%(relativeCreated)d %(levelname)s %(name)s: %(message)s"))
    logging.basicConfig(handlers=[log], level=logging.INFO)
    os.environ.update(spec.get("environment", {}))
    with socket.socket(socket.AF_UNIX) as control:
        control.connect(spec["control"])
        actor = Actor(spec["name"], spec["transport"], spec["options"], Path(spec["journal"]))
        control.sendall(b"{}\n")
        with control.makefile("r") as asked:
            for line in asked:
                control.sendall(_answer(actor, json.loads(line)))
        actor.close()


def _answer(actor: Actor, asked: dict[str, Any]) -> bytes:
    try:
        answer = {"said": getattr(actor, asked.pop("do"))(**asked)}
    except Exception as exc:  # told to who asked
        answer = {"failed": f"{type(exc).__name__}: {exc}"}
    return json.dumps(answer).encode() + b"\n"


def nursery() -> None:
    """Fork an actor for each line of the standard input, and say its process id."""
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # no code waits for them
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    for line in sys.stdin:
        spec = json.loads(line)
        with contextlib.suppress(RobocompError):
            find_transport(spec["transport"])
        child = os.fork()
        if child == 0:
            os.close(0)
            os.open(os.devnull, os.O_RDONLY)
            said = os.open(spec["log"], os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
            os.dup2(said, 1)
            os.dup2(said, 2)
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            code = 1
            try:
                act(spec)
                code = 0
            except BaseException:
                logging.getLogger("actor").exception("%s ends", spec["name"])
            finally:
                os._exit(code)
        print(child, flush=True)


if __name__ == "__main__":
    nursery()
