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
from .clock import MAX, speed_of
from .common import FINE, counted
from .completing import What, completed
from .live import (
    COMPONENT,
    EXIT_STATUS,
    RECORDING,
    Absent,
    Wrong,
    add_json,
    add_middleware,
    add_waiting,
    awaited,
    components_named,
    reported,
    say,
)

if TYPE_CHECKING:
    from ..lockstep.RoboCompClock import ClockState
    from ..tools.network import Network
    from ..tools.recording.reader import Recording
    from ..tools.replay.answers import Answer
    from ..tools.replay.choice import Part
    from ..tools.replay.leading import Followed
    from ..tools.replay.pace import Pace
    from ..tools.replay.player import Delays, Keys
    from ..tools.replay.stage import Stage

NAME = "replay"

_EXAMPLES = f"""\
examples:
  rc replay run1                                 all of its topics, once something subscribes to any of them
  rc replay run1 --only LaserPub --loop          one interface, again and again, until Ctrl-C
  rc replay run1 --start 12 --for 5 --rate 0.5   five seconds of it, at half the speed
  rc replay run1 --remap world=ghost             as the topics of another instance
  rc replay run1 --remap pushLaserData=pushScan  as the operation is called now
  rc replay run1 --answer                        and answers to the queries that were recorded
  rc replay run1 --paused                        message by message, with the key s
  rc replay run1 --clock                         ... and lead the clock that components follow
  rc replay run1 --clock --rate max              as fast as these components can, in lock-step

Keys: space pauses and goes on, s sends the next message, + and - double and halve the rate.

Each topic is published over all middlewares by which something subscribes to it, also if that appears later. Commands
may move a robot, so they are sent only if --only names them. With --answer, queries
are served over all middlewares by which something calls them. The answer is the newest response that was recorded until
then, whatever is asked; before the first one, it is the first.

With --clock, the replay takes the place of the component that leads the clock of a network, as in `clock world;`, which
must not run. The clock passes with the recording, also in pauses and at other rates, and `rc clock` drives both. In
lock-step, the components do the same at the same instants each time.

{EXIT_STATUS}
"""


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description = "Publish the topics of a recording again, as they were in time."
    to.epilog = _EXAMPLES
    completed(to.add_argument("recording", type=Path, metavar="RECORDING", help=RECORDING), ".mcap")
    about = f"2 is twice as fast (default: 1); {MAX}, with --clock in lock-step: as fast as possible"
    to.add_argument("--rate", type=speed_of, default=1.0, metavar="FACTOR", help=about)
    add_span(to)
    to.add_argument("--loop", action="store_true", help="begin again at the end, until Ctrl-C")
    about = "only topics of this name; may be repeated"
    completed(to.add_argument("--only", action="append", default=[], metavar="NAME", help=about), What.RECORDED)
    to.add_argument(
        "--remap",
        action="append",
        default=[],
        metavar="OLD=NEW",
        help="replace a part of names, as in world=ghost, also of an operation that was renamed; may be repeated",
    )
    to.add_argument(
        "--answer",
        action="store_true",
        help="also serve recorded queries, with the newest response until then",
    )
    to.add_argument("--paused", action="store_true", help="begin with a pause; needs a terminal")
    to.add_argument("--beside", action="store_true", help="publish topics also if something else publishes them now")
    to.add_argument("--clock", action="store_true", help="lead the clock that components follow")
    about = f"the leader whose place --clock takes, if several clocks are followed: {COMPONENT}"
    completed(to.add_argument("--of", metavar="COMPONENT", help=about), What.COMPONENT)
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
        if options.of and not options.clock:
            raise ConfigurationError("--of names the leader of a clock: it needs --clock")
        if not options.rate and not options.clock:
            raise ConfigurationError(f"--rate {MAX} needs --clock, by which the replay learns when components are done")
        remaps = [remap(each) for each in options.remap]
        with Recording(options.recording) as recording:
            parts, left_out = parts_of(recording, options.only, remaps)
            answers = answers_of(recording, options.only, remaps) if options.answer else []
            for name in left_out.keys() - {each.topic.name for each in answers}:
                _tell(f"{name} is left out: {left_out[name]}")
            if options.answer and not answers:
                if options.only and answers_of(recording, (), remaps):
                    raise Absent(f"{options.recording}: its queries are left out by --only; name them there, too")
                raise Absent(f"{options.recording}: it has no queries; `rc record --calls` records them")
            if not parts and not answers:
                raise Absent(f"{options.recording}: it has nothing to replay")
            return _replay(recording, parts, answers, options)
    return code()


def _replay(recording: Recording, parts: list[Part], answers: list[Answer], options: argparse.Namespace) -> int:
    from ..tools.access import Access
    from ..tools.census import take_census
    from ..tools.replay.ahead import Ahead
    from ..tools.replay.answers import Answers
    from ..tools.replay.leading import leading
    from ..tools.replay.pace import Pace
    from ..tools.replay.player import Player
    from ..tools.replay.stage import Stage

    start, end = span_of(options, recording)
    clock = _clock(options) if options.clock else None
    parts = [each for each in parts if clock is None or each.channel != f"{clock.leader}/Clock/tick"]
    names = [*(each.topic.name for each in parts), *(each.topic.name for each in answers)]
    if next(recording.messages(names, start, end), None) is None:
        raise Absent(f"{options.recording}: it has no messages there; it takes {_seconds(recording):.1f} s")
    census = partial(take_census, options.middleware, own=True)
    census()  # a middleware that there is not is told before anything else
    _check_free(parts, answers, options)
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
            length = _length(recording, options)
            reading = Ahead(recording, names, start=start, end=end, is_loop=options.loop)
            with reading as messages, _keys() as keys:
                pace = Pace(time.monotonic_ns(), options.rate, is_paused=options.paused)
                player = None if clock else Player(pace, keys, send, partial(_show_pace, seconds=length))
                begun = time.monotonic()
                try:
                    if player:
                        player.play(messages)
                    elif clock:
                        led = leading(access, clock, parts, send, lambda: serving.queries, options.rate)
                        led.play(messages, keys, partial(_show_clock, seconds=length), is_paused=options.paused)
                finally:
                    seconds = time.monotonic() - begun
                    _sum_up(parts, answers, stage, player.delays if player else None, seconds, options)
    return FINE


def _check_free(parts: list[Part], answers: list[Answer], options: argparse.Namespace) -> None:
    """Raise Absent if something publishes or serves now what the replay would."""
    from ..tools.census import take_census
    from ..tools.replay.answers import servers
    from ..tools.replay.choice import clashes

    there = take_census(own=True)
    if found := servers(answers, there):
        raise Absent(f"{found[0]}; stop it, or leave it out by --only or --remap")
    if not options.beside and (found := clashes(parts, there)):
        more = f", and {len(found) - 1} more" if len(found) > 1 else ""
        raise Absent(f"{found[0]}{more}; stop it, publish under another name with --remap, or add --beside")


def _clock(options: argparse.Namespace) -> Followed:
    """A clock that components follow and that nothing leads, once there is one.

    Raises Absent and ConfigurationError.
    """
    from ..errors import ConfigurationError
    from ..tools.replay.leading import followed, leaders

    def pick(network: Network) -> Followed:
        found = {each.leader: each for each in followed(network)}
        led = leaders(network)
        try:
            chosen = components_named([*found, *led], [options.of] if options.of else [])
        except Absent as exc:
            raise ValueError(str(exc)) from exc
        free = [found[each] for each in chosen if each in found]
        if len(free) > 1:
            listed = ", ".join(each.leader for each in free)
            raise Wrong(f"several clocks are followed; choose one by --of: {listed}")
        if free:
            return free[0]
        if led:
            raise ValueError(f"{led[0]} leads the clock; stop it, so that the replay can take its place")
        raise ValueError("no component follows a clock here; let them do it: rcdeploy NET.ddsl --clock world")

    clock = awaited(options, pick)
    if not options.rate and not clock.is_lockstep:
        raise ConfigurationError(f"--rate {MAX} is for a clock in lock-step; that of {clock.leader} passes by itself")
    return clock


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


def _show_pace(pace: Pace, now: int, *, seconds: float) -> None:
    _show(pace.position(now), pace.rate, pace.is_paused, seconds)


def _show_clock(state: ClockState, position: int, *, seconds: float) -> None:
    _show(position, state.speed, state.paused, seconds)


def _show(position: int, rate: float, is_paused: bool, seconds: float) -> None:
    if not sys.stderr.isatty():
        return
    state = "paused" if is_paused else f"× {rate:g}" if rate else f"× {MAX}"
    keys = "  (space, s, +, -)" if _has_keys() else ""
    print(f"\r\x1b[K{position / 1e9:.1f} of {seconds:.1f} s, {state}{keys}", end="", file=sys.stderr, flush=True)


# The end.


def _sum_up(
    parts: list[Part],
    answers: list[Answer],
    stage: Stage,
    late: Delays | None,
    seconds: float,
    options: argparse.Namespace,
) -> None:
    _clear()
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
        punctual = late._asdict() if late else None
        told = {"recording": str(options.recording), "seconds": seconds, "late": punctual, "topics": topics}
        print(json.dumps({**told, "queries": queries}), flush=True)
        return
    messages = sum(each.sent for each in parts if stage.ways(each))
    print(f"{options.recording}: {counted(messages, 'message')} in {seconds:.1f} s, {_lateness(late)}", flush=True)
    for each in parts:
        print(f"  {each.channel}: {_fate(each, stage.ways(each))}", flush=True)
    for query in answers:
        answered = f"{counted(query.answered, 'call')} answered"
        over = f"{answered} over {', '.join(query.ways)}" if query.ways else "nothing called it"
        print(f"  {query.channel}: {over}", flush=True)


def _lateness(late: Delays | None) -> str:
    if late is None:
        return "by the clock that it led"
    median, p99, longest = (f"{each * 1e3:.1f} ms" for each in late[:3])
    held_up = f", held up for {late.held_up:.1f} s" if late.held_up else ""
    return f"late by {median} (99 % within {p99}, at most {longest}){held_up}"


def _fate(part: Part, ways: list[str]) -> str:
    if not ways:
        return "nothing subscribed to it"
    wrong = f"; {part.failed} could not be sent" if part.failed else ""
    wrong += f"; {part.malformed} do not fit their contract" if part.malformed else ""
    return f"{counted(part.sent, 'message')} over {', '.join(ways)}{wrong}"
