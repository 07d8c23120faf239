"""`rc replay`: publishes a recording again."""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import select
import signal
import sys
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .bag import add_span, span_of
from .common import FINE
from .live import EXIT_STATUS, Absent, add_json, add_middleware, add_waiting, positive, reported, say

if TYPE_CHECKING:
    from ..tools.recording.reader import Recording
    from ..tools.replay.answers import Answer
    from ..tools.replay.choice import Part
    from ..tools.replay.pace import Pace
    from ..tools.replay.player import Delays, Keys, Player
    from ..tools.replay.stage import Stage

NAME = "replay"
HELP = "publish a recording again, as it was in time"

_EXAMPLES = f"""\
examples:
  rc replay run1                                 all of its topics, once something subscribes to any of them
  rc replay run1 --only LaserPub --loop          one interface, again and again, until Ctrl-C
  rc replay run1 --start 12 --for 5 --rate 0.5   five seconds of it, at half the speed
  rc replay run1 --remap world=ghost             as the topics of another instance
  rc replay run1 --answer                        and answers to the queries that were recorded
  rc replay run1 --paused                        message by message, with the key s

Keys: space pauses and goes on, s sends the next message, + and - double and halve the rate.

Each topic is published over all middlewares by which something subscribes to it, also if that appears later. Commands
may move a robot, so they are sent only if --only names them. With --answer, queries
are served over all middlewares by which something calls them. The answer is the newest response that was recorded until
then, whatever is asked; before the first one, it is the first.

{EXIT_STATUS}
"""


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description = "Publish the topics of a recording again, as they were in time."
    to.epilog = _EXAMPLES
    to.formatter_class = argparse.RawDescriptionHelpFormatter
    to.add_argument("recording", type=Path, metavar="RECORDING", help="a folder of `rc record`, or a file *.mcap")
    to.add_argument("--rate", type=positive, default=1.0, metavar="FACTOR", help="2 is twice as fast (default: 1)")
    add_span(to)
    to.add_argument("--loop", action="store_true", help="begin again at the end, until Ctrl-C")
    to.add_argument(
        "--only", action="append", default=[], metavar="NAME", help="only topics of this name; may be repeated"
    )
    to.add_argument(
        "--remap",
        action="append",
        default=[],
        metavar="OLD=NEW",
        help="replace a part of names, as in world=ghost; may be repeated",
    )
    to.add_argument(
        "--answer",
        action="store_true",
        help="also serve recorded queries, with the newest response until then",
    )
    to.add_argument("--paused", action="store_true", help="begin with a pause; needs a terminal")
    to.add_argument("--beside", action="store_true", help="publish topics also if something else publishes them now")
    add_waiting(to)
    add_middleware(to)
    add_json(to)


def run(options: argparse.Namespace) -> int:
    from ..errors import ConfigurationError
    from ..tools.recording.reader import Recording
    from ..tools.replay.answers import answers_of
    from ..tools.replay.choice import parts_of, remap

    with reported("rc replay") as code:
        if options.paused and not _has_keys():
            raise ConfigurationError("--paused needs a terminal, since a key ends the pause")
        remaps = [remap(each) for each in options.remap]
        with Recording(options.recording) as recording:
            parts, left_out = parts_of(recording, options.only, remaps)
            answers = answers_of(recording, options.only, remaps) if options.answer else []
            for name in left_out.keys() - {each.topic.name for each in answers}:
                _tell(f"{name} is left out: {left_out[name]}")
            if options.answer and not answers:
                raise Absent(f"{options.recording}: it has no queries; `rc record --calls` records them")
            if not parts and not answers:
                raise Absent(f"{options.recording}: it has nothing to replay")
            return _replay(recording, parts, answers, options)
    return code()


def _replay(recording: Recording, parts: list[Part], answers: list[Answer], options: argparse.Namespace) -> int:
    from ..tools.access import Access
    from ..tools.census import take_census
    from ..tools.replay.ahead import Ahead
    from ..tools.replay.answers import Answers, servers
    from ..tools.replay.choice import clashes
    from ..tools.replay.pace import Pace
    from ..tools.replay.player import Player
    from ..tools.replay.stage import Stage

    start, end = span_of(options, recording)
    names = [*(each.topic.name for each in parts), *(each.topic.name for each in answers)]
    if next(recording.messages(names, start, end), None) is None:
        raise Absent(f"{options.recording}: it has no messages there; it takes {_seconds(recording):.1f} s")
    census = partial(take_census, options.middleware, own=True)
    census()  # a middleware that there is not is told before anything else
    there = take_census(own=True)
    if found := servers(answers, there):
        raise Absent(f"{found[0]}; stop it, or leave it out by --only or --remap")
    if not options.beside and (found := clashes(parts, there)):
        more = f", and {len(found) - 1} more" if len(found) > 1 else ""
        raise Absent(f"{found[0]}{more}; stop it, publish under another name with --remap, or add --beside")
    with Access() as access:
        serving = Answers(access, answers, _tell, always=options.middleware)
        serving.begin(recording, start, end)
        stage = Stage(access, parts, census, _tell, always=options.middleware, also=serving.look)

        def send(topic: str, data: bytes) -> None:
            if not serving.note(topic, data):
                stage.send(topic, data)

        with stage:
            if not stage.wait_heard(options.timeout):
                raise Absent(_unused(parts, answers))
            stage.watch()
            reading = Ahead(recording, names, start=start, end=end, is_loop=options.loop)
            with reading as messages, _keys() as keys:
                pace = Pace(time.monotonic_ns(), options.rate, is_paused=options.paused)
                player = Player(pace, keys, send, partial(_show, seconds=_length(recording, options)))
                begun = time.monotonic()
                try:
                    player.play(messages)
                finally:
                    _sum_up(parts, answers, stage, player, time.monotonic() - begun, options)
    return FINE


def _seconds(recording: Recording) -> float:
    return (recording.end - recording.start) / 1e9


def _length(recording: Recording, options: argparse.Namespace) -> float:
    rest: float = max(0.0, _seconds(recording) - options.start)
    return min(rest, float(options.seconds)) if options.seconds else rest


def _named(parts: list[Part]) -> str:
    first, *others = sorted({each.channel for each in parts})
    return f"{first} or to {len(others)} other topics of the recording" if others else first


def _unused(parts: list[Part], answers: list[Answer]) -> str:
    wrong = [f"nothing subscribes to {_named(parts)}"] if parts else []
    wrong += [f"nothing calls {', '.join(each.channel for each in answers)}"] if answers else []
    return f"{', and '.join(wrong)}; `rc list --channels` shows all"


# The terminal.


def _has_keys() -> bool:
    return sys.stdin is not None and sys.stdin.isatty()


@contextlib.contextmanager
def _keys() -> Iterator[Keys]:
    """Keys of the terminal, if there is one; they are read without Return, and not shown."""
    if not _has_keys():
        yield _NoKeys()
        return
    import termios
    import tty

    descriptor = sys.stdin.fileno()
    before = termios.tcgetattr(descriptor)

    def set_up(*_: Any) -> None:
        tty.setcbreak(descriptor, termios.TCSANOW)

    previous = signal.signal(signal.SIGCONT, set_up)  # a shell takes its own settings while a command is stopped
    set_up()
    try:
        yield _TerminalKeys(descriptor)
    finally:
        signal.signal(signal.SIGCONT, previous)
        termios.tcsetattr(descriptor, termios.TCSADRAIN, before)


class _NoKeys:
    def wait(self, seconds: float) -> str:
        time.sleep(seconds)
        return ""


class _TerminalKeys:
    def __init__(self, descriptor: int) -> None:
        self._descriptor, self._is_open = descriptor, True

    def wait(self, seconds: float) -> str:
        if not self._is_open:
            time.sleep(seconds)
            return ""
        ready, _, _ = select.select([self._descriptor], [], [], seconds)
        if not ready:
            return ""
        key = os.read(self._descriptor, 1)
        self._is_open = bool(key)
        return key.decode("ascii", "replace")


def _tell(text: str) -> None:
    _clear()
    say("rc replay", text)


def _clear() -> None:
    """Remove the line that shows the progress."""
    if sys.stderr.isatty():
        print("\r\x1b[K", end="", file=sys.stderr, flush=True)


def _show(pace: Pace, now: int, *, seconds: float) -> None:
    if not sys.stderr.isatty():
        return
    state = "paused" if pace.is_paused else f"× {pace.rate:g}"
    keys = "  (space, s, +, -)" if _has_keys() else ""
    position = f"{pace.position(now) / 1e9:.1f} of {seconds:.1f} s"
    print(f"\r\x1b[K{position}, {state}{keys}", end="", file=sys.stderr, flush=True)


# The end.


def _sum_up(
    parts: list[Part],
    answers: list[Answer],
    stage: Stage,
    player: Player,
    seconds: float,
    options: argparse.Namespace,
) -> None:
    _clear()
    late = player.delays
    topics = [
        {
            "channel": each.channel,
            "recorded_as": each.topic.name,
            "messages": each.sent if stage.ways(each) else 0,
            "middlewares": stage.ways(each),
            "failed": each.failed,
            "malformed": each.malformed,
        }
        for each in parts
    ]
    if options.json:
        queries = [
            {"channel": each.channel, "answered": each.answered, "middlewares": list(each.ways)} for each in answers
        ]
        told = {"recording": str(options.recording), "seconds": seconds, "late": late._asdict(), "topics": topics}
        print(json.dumps({**told, "queries": queries}), flush=True)
        return
    messages = sum(each.sent for each in parts if stage.ways(each))
    print(f"{options.recording}: {messages} messages in {seconds:.1f} s, {_lateness(late)}", flush=True)
    for each in parts:
        print(f"  {each.channel}: {_fate(each, stage.ways(each))}", flush=True)
    for query in answers:
        over = f"{query.answered} calls answered over {', '.join(query.ways)}" if query.ways else "nothing called it"
        print(f"  {query.channel}: {over}", flush=True)


def _lateness(late: Delays) -> str:
    median, p99, longest = (f"{each * 1e3:.1f} ms" for each in late[:3])
    held_up = f", held up for {late.held_up:.1f} s" if late.held_up else ""
    return f"late by {median} (99 % within {p99}, at most {longest}){held_up}"


def _fate(part: Part, ways: list[str]) -> str:
    if not ways:
        return "nothing subscribed to it"
    wrong = f"; {part.failed} could not be sent" if part.failed else ""
    wrong += f"; {part.malformed} do not fit their contract" if part.malformed else ""
    return f"{part.sent} messages over {', '.join(ways)}{wrong}"
