"""`python -m robocomp_py.tools.scout`: looks at what runs on this host, for a tool on another one.

The agent of `rcdeploy` starts it on request. It reads questions from its standard input and writes answers to its
standard output, objects of JSON, one a line, and ends with its input:

    {"id": 1, "do": "census", "middlewares": ["shm"]}    all ends of channels; without middlewares, of all that can tell
    {"id": 1, "do": "hear", "channels": […]}             messages of these topics; with "full": true, not shortened;
                                                         with "over": […], each of them over this middleware
    {"id": 1, "do": "octets", "channels": ["…"], "fingerprint": 7}
                                                         messages of this topic, with this contract, not decoded
    {"id": 1, "do": "arrivals", "channels": […]}         when messages of these topics come in; with "over", as above
    {"id": 1, "do": "call", "channel": "…", "arguments": {…}, "within": 5}
                                                         call a query, or send a command
    {"id": 1, "do": "publish", "channel": "…", "arguments": {…}, "within": 5, "rate": 20, "most": 100,
        "latched": false, "keep": false}
                                                         publish to subscribers of a topic
    {"id": 1, "do": "clock"}                             what time it is on this host
    {"id": 1, "do": "leftovers", "middlewares": ["shm"]}
                                                         what killed processes have left
    {"id": 1, "do": "machine", "middlewares": ["shm"], "processes": [10, 11]}
                                                         limits and space, and what these processes use
    {"id": 1, "do": "cease"}                             end the question with this number
    {"id": 0, "do": "took", "octets": 300000}            the tool has taken this number of octets: send more

A question may have `"options"`, by the names of middlewares: the scout opens these with them, as components there do.

    {"id": 1, "ends": […], "texts": {…}}                 some ends, as `told_in` reads them, and contracts not sent yet
    {"id": 1, "tellers": ["shm"], "troubles": […]}       which middlewares could tell, and what went wrong
    {"id": 1, "message": […]}                            channel, decoded message, number of messages dropped before
                                                         it, when and as which number it was sent (or null)
    {"id": 1, "octets": […]}                             source, number and stamp of a message, the place of this part
                                                         of it, the number of its parts, and standard CDR in base64
    {"id": 1, "presence": ["…", false]}                  a topic, and whether something publishes it now
    {"id": 1, "arrivals": [[…]], "now": 12.5}            channel, time by the clock of `now`, octets, source, number,
                                                         age (or null) of each message
    {"id": 1, "result": {…}}                             what a query has answered
    {"id": 1, "thrown": "…", "fields": {…}}              the declared exception that it has raised
    {"id": 1, "clock": 1.5}                              seconds since 1970
    {"id": 1, "leftovers": […]}                          objects of `doctor.facts`, as `doctor.elsewhere` reads them
    {"id": 1, "machine": {…}}
    {"id": 1, "error": "…", "kind": "Timeout"}           a sentence for people, and the class of the exception
    {"id": 1, "end": true}                               the last answer to a question
"""

from __future__ import annotations

import base64
import contextlib
import json
import math
import os
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import asdict
from functools import partial
from typing import IO, Any

from ..contract.interface import Pattern
from ..contract.qos import from_traits
from ..errors import ContractMismatch, DecodeError, EncodeError, RobocompError, Unreachable
from ..threads import start_thread
from ..transports.base import Heard
from ..wire import json as values
from .access import Access, ThrownError
from .census import take_census, take_each
from .network import Channel, End, Network
from .posts import WINDOW, weight
from .traffic import Arrival

LONGEST = 512 * 1024
"""Octets of a line."""

MOST = 256
"""Questions that are answered at a time."""

_ENDS = 200
"""Ends in one line, at most."""

_TOGETHER = 1000
"""Arrivals in one line, at most."""

_RECENT = 1.0
"""Seconds for which a census is used again by calls."""

_LOOK = 0.1
"""Seconds between two looks at whether a question is to end."""

_PART = LONGEST // 2
"""Octets of a part of a message."""

_ENOUGH = LONGEST // 4
"""Characters of ends and contracts after which a line is sent."""

Message = Mapping[str, Any]
Answer = Callable[..., None]
"""Sends an answer to one question: `answer(ends=[…])`."""


class Scout:
    """Answers questions, each on a thread of its own, through `tell`, which is called by one thread at a time."""

    def __init__(self, tell: Callable[[Message], object]) -> None:
        self._tell, self._telling = tell, threading.Lock()
        self._lock = threading.Lock()
        self._asked: dict[int, tuple[threading.Thread, threading.Event]] = {}
        """By the number of a question: its thread, and whether it is to end."""
        self._place = _Place()

    def ask(self, question: Message) -> None:
        """Start to answer a question. The answer to one that is not understood is an error."""
        number, do = question.get("id"), question.get("do")
        if not isinstance(number, int):
            return
        if do == "cease":
            if asked := self._asked.get(number):
                asked[1].set()
            return
        if do == "took":
            if isinstance(octets := question.get("octets"), int):
                self._place.window.widen(octets)
            return
        deed = _DEEDS.get(str(do))
        with self._lock:
            if deed is None or number in self._asked or len(self._asked) >= MOST:
                why = f"there is no question `{do}`" if deed is None else "too many questions at a time"
                self._answer(number, error=why)
                self._answer(number, end=True)
                return
            over = threading.Event()
            thread = threading.Thread(target=self._run, args=(number, deed, question, over), name=f"{do} {number}")
            self._asked[number] = thread, over
        start_thread(thread)

    def close(self) -> None:
        """End all questions, and wait until their threads have ended."""
        with self._lock:
            asked = list(self._asked.values())
        for _, over in asked:
            over.set()
        self._place.access.close()  # which ends the calls that wait
        for thread, _ in asked:
            thread.join()

    def _run(self, number: int, deed: _Deed, question: Message, over: threading.Event) -> None:
        try:
            deed(self._place, question, lambda **said: self._answer(number, **said), over)
        except (RobocompError, ValueError, TypeError, KeyError) as exc:
            self._answer(number, error=str(exc) or repr(exc), kind=type(exc).__name__)
        finally:
            with self._lock:
                del self._asked[number]
            self._answer(number, end=True)

    def _answer(self, number: int, **said: Any) -> None:
        with self._telling:
            self._tell({"id": number, **said})


class _Place:
    """What a scout uses of its host for its calls."""

    def __init__(self) -> None:
        self.access = Access()
        self.window = _Window()
        self._lock = threading.Lock()
        self._seen: dict[tuple[str, ...], tuple[float, Network]] = {}

    def channel(self, question: Message) -> Channel:
        """The channel that a question names whole. Raises ValueError."""
        name = str(question["channel"])

        def served(network: Network) -> Channel:
            if name not in network.channels or not network.channels[name].providers:
                raise ValueError(f"no component serves {name}")
            return network.channels[name]

        return self._found(question, served)

    def topic(self, question: Message) -> Channel:
        """The topic that a question names whole. Raises ValueError."""
        return self._found(question, lambda network: network.topic(str(question["channel"])))

    def _found(self, question: Message, find: Callable[[Network], Channel]) -> Channel:
        """What `find` finds in a census that is at most a second old, or else in a new one. Raises ValueError."""
        key = tuple(_middlewares(question))
        with self._lock:
            at, network = self._seen.get(key, (0.0, None))
            if network is not None and time.monotonic() - at <= _RECENT:
                with contextlib.suppress(ValueError):
                    return find(network)
            network = _seen(question)
            self._seen = {key: (time.monotonic(), network)}
        return find(network)


class _Window:
    """The number of octets that may be sent before the tool has taken some of them."""

    def __init__(self) -> None:
        self._open = threading.Condition()
        self._free = WINDOW

    def widen(self, octets: int) -> None:
        with self._open:
            self._free = min(WINDOW, self._free + max(0, octets))
            self._open.notify_all()

    def wait(self, octets: int, over: threading.Event) -> bool:
        """Wait until this number of octets may be sent. Returns False if the question ends before."""
        with self._open:
            while self._free < octets:
                if over.is_set():
                    return False
                self._open.wait(_LOOK)
            self._free -= octets
        return True


_Deed = Callable[[_Place, Message, Answer, threading.Event], None]


def _census(place: _Place, question: Message, answer: Answer, over: threading.Event) -> None:
    seen = take_each(_middlewares(question), _options(question))
    for part in parts_of(seen.ends):
        answer(**part)
    answer(tellers=sorted(*seen.tellers.values()), troubles=seen.troubles)


def _clock(place: _Place, question: Message, answer: Answer, over: threading.Event) -> None:
    answer(clock=time.time())


def _leftovers(place: _Place, question: Message, answer: Answer, over: threading.Event) -> None:
    from .doctor.collect import leftovers

    answer(leftovers=[asdict(each) for each in leftovers(_middlewares(question))])


def _machine(place: _Place, question: Message, answer: Answer, over: threading.Event) -> None:
    from .doctor.collect import machine, shared_memory

    found = machine(map(int, question["processes"]), memory=shared_memory(_middlewares(question)))
    answer(machine=asdict(found))


def _hear(place: _Place, question: Message, answer: Answer, over: threading.Event) -> None:
    from .shortening import shortened
    from .tap import tap

    full, published = bool(question.get("full")), dict[str, bool]()
    with tap(_topics(question)) as tapping:
        while not over.is_set():
            if heard := tapping.take(_LOOK):
                published[heard.channel] = True
                shown = heard.message
                if not full:
                    shown = shortened(shown)
                elif len(json.dumps(shown)) > LONGEST // 2:
                    shown = f"not sent to another host: as JSON, it has more than {LONGEST // 2} octets"
                answer(message=[heard.channel, shown, heard.dropped, heard.sent, heard.number])
                continue
            for (channel, _), is_published in tapping.presences().items():
                if published.get(channel) is not is_published:
                    published[channel] = is_published
                    answer(presence=[channel, is_published])


def _octets(place: _Place, question: Message, answer: Answer, over: threading.Event) -> None:
    from .recording.writer import to_cdr
    from .tap import DEPTH, Inbox

    (topic,) = _topics(question)
    operation = topic.operation
    if operation.fingerprint != question["fingerprint"]:
        raise ContractMismatch(f"{topic.name} has another contract now")
    convert = to_cdr(place.access.codec(topic), operation.request)
    inbox = Inbox(DEPTH)
    heard = place.access.hear(topic, partial(inbox.put, topic.name), DEPTH, headed=True)
    with contextlib.closing(heard.link):
        while not over.is_set():
            found = inbox.get(_LOOK)
            if found is None or not isinstance(message := found[0].heard, Heard):
                continue
            try:
                data = memoryview(convert(message.payload))
            except (DecodeError, EncodeError):
                continue  # the tool notices that its number is missing
            parts = max(1, math.ceil(len(data) / _PART))
            for at in range(parts):
                text = base64.b64encode(data[at * _PART : (at + 1) * _PART]).decode()
                if not place.window.wait(weight(text), over):
                    return
                answer(octets=[message.source, message.sequence, message.stamp, at, parts, text])


def _call(place: _Place, question: Message, answer: Answer, over: threading.Event) -> None:
    channel = place.channel(question)
    operation, deadline = channel.operation, float(question["within"])
    values_ = values.take_fields(operation.inputs, question["arguments"], operation.name)
    if channel.pattern is Pattern.COMMAND:
        place.access.send(channel, values_, deadline, deadline)
        answer(result={})
        return
    try:
        answer(result=values.show_fields(operation.outputs, place.access.ask_again(channel, values_, deadline)))
    except ThrownError as exc:
        answer(thrown=exc.kind.name, fields=values.show_fields(exc.kind.all_fields, exc.values))


def _publish(place: _Place, question: Message, answer: Answer, over: threading.Event) -> None:
    from .publishing import publish

    latched, keep = question.get("latched") is True, question.get("keep") is True
    channel = place.topic(question) if keep else _seen(question).topic(str(question["channel"]))
    if not channel.users and not latched:
        raise Unreachable(f"nothing subscribes to {channel.name}")
    values_ = values.take_fields(channel.operation.inputs, question["arguments"], channel.operation.name)
    qos = from_traits(traits) if (traits := str(question.get("traits") or "")) else None
    within, rate, most = float(question["within"]), question.get("rate"), question.get("most")
    publish(
        place.access, channel, values_, within, rate=rate, most=most, qos=qos, latched=latched, keep=keep, over=over
    )


def _seen(question: Message) -> Network:
    return take_census(_middlewares(question), own=True, options=_options(question))


def _options(question: Message) -> Mapping[str, Mapping[str, Any]]:
    given = question.get("options")
    return {str(name): each for name, each in given.items() if isinstance(each, dict)} if given else {}


def _middlewares(question: Message) -> list[str]:
    return [str(each) for each in question.get("middlewares") or ()]


def _arrivals(place: _Place, question: Message, answer: Answer, over: threading.Event) -> None:
    from .tap import arrivals

    waiting: list[list[Any]] = []
    told_at = time.monotonic()
    for each in arrivals(_topics(question), first=math.inf, whole=None):
        if over.is_set():
            return
        if isinstance(each, Arrival):
            age = None if math.isnan(each.age) else each.age
            waiting.append([each.channel, each.at, each.octets, each.source, each.sequence, age])
        now = time.monotonic()
        if len(waiting) >= _TOGETHER or (waiting and now - told_at >= _LOOK):
            told_at = now
            answer(arrivals=waiting, now=now)
            waiting = []


def _topics(question: Message) -> list[Channel]:
    """The topics that a question names whole. Raises ValueError."""
    network, names = _seen(question), [str(each) for each in question["channels"]]
    topics = [network.topic(each) for each in names]
    over = question.get("over")
    return [_over(str(middleware), topic) for topic, middleware in zip(topics, over, strict=True)] if over else topics


def _over(middleware: str, topic: Channel) -> Channel:
    """A topic over one middleware. Raises ValueError."""
    ends = [each for each in topic.providers or topic.users if each.middleware == middleware]
    if not ends:
        raise ValueError(f"nothing publishes {topic.name} over {middleware}")
    return Channel(topic.name, topic.pattern, ends)


_DEEDS: Mapping[str, _Deed] = {
    "census": _census,
    "clock": _clock,
    "leftovers": _leftovers,
    "machine": _machine,
    "hear": _hear,
    "octets": _octets,
    "arrivals": _arrivals,
    "call": _call,
    "publish": _publish,
}


def parts_of(ends: Iterable[End]) -> Iterator[dict[str, Any]]:
    """Ends in parts that fit in lines. Each contract is in one of them only. `told_in` reads them."""
    sent: set[int] = set()
    part: list[list[Any]] = []
    texts: dict[str, str] = {}
    size = 0
    for each in ends:
        told = each.told
        part.append([each.middleware, told.owner, told.pid, told.role, told.channel, told.fingerprint, told.traits])
        size += sum(len(text) for text in (told.owner, told.channel, told.traits)) + 100
        if told.fingerprint not in sent:
            sent.add(told.fingerprint)
            if len(told.text) <= _ENOUGH:
                texts[f"{told.fingerprint:x}"] = told.text
                size += len(told.text)
        if len(part) >= _ENDS or size >= _ENOUGH:
            yield {"ends": part, "texts": texts}
            part, texts, size = [], {}, 0
    if part:
        yield {"ends": part, "texts": texts}


def main(into: IO[bytes], out: IO[bytes]) -> int:
    def tell(message: Message) -> None:
        data = json.dumps(message).encode() + b"\n"
        if len(data) > LONGEST:
            short = {"id": message["id"], "error": f"an answer has more than {LONGEST} octets"}
            data = json.dumps(short).encode() + b"\n"
        out.write(data)
        out.flush()

    scout = Scout(tell)
    try:
        while line := into.readline(LONGEST):
            try:
                question = json.loads(line)
            except (ValueError, RecursionError):
                continue
            if isinstance(question, dict):
                scout.ask(question)
    finally:
        scout.close()
    return 0


def _run() -> int:
    """Keep the standard output for answers: what a library prints must not get in between."""
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    try:
        return main(sys.stdin.buffer, out)
    except BrokenPipeError:
        return 0


if __name__ == "__main__":
    raise SystemExit(_run())
