"""`rc record`: what is published, into files."""

from __future__ import annotations

import argparse
import contextlib
import gc
import json
import re
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .common import FINE, UNREACHABLE, counted
from .completing import What, completed
from .hosts import add_hosts, hosts_of
from .live import (
    EXIT_STATUS,
    TOPIC,
    Absent,
    add_definitions,
    add_json,
    add_middleware,
    add_waiting,
    count,
    nothing_published,
    positive,
    reported,
    say,
)
from .progress import Progress

if TYPE_CHECKING:
    from ..tools.hosts import Hosts
    from ..tools.network import Network
    from ..tools.recording.session import Session, Track
    from ..tools.recording.tellers import Tellers
    from ..tools.recording.writer import Recorder

NAME = "record"

_EXAMPLES = f"""\
examples:
  rc record                                all topics, also those that appear later, until Ctrl-C
  rc record LaserPub world -o run1         only these, into the folder run1
  rc record GotoPoint --calls --logs       calls of these operations, and what all components log
  rc record --split 1GB --keep 10          a ring: files of 1 GB, of which the last ten are kept
  rc record --compress lz4 --for 60        smaller files; for one minute
  rc record --schema omgidl                with the names of the IDSL, for Foxglove
  rc record --host base --host here        of the hosts of a network, only these (default: all)

The folder is a ROS 2 bag: ROS 2, Foxglove, PlotJuggler and rosbags open it. No publisher waits for this command. What a
slow disk cannot take in time is lost, and counted at the end. `rc bag mend` makes an interrupted recording readable.
Calls are told by the components that make them, or with --served by those that serve them. Each operation has a topic
of its calls, as /wander/GotoPoint/go/calls; log records are in /rosout, as in ROS 2.

Topics of other hosts come over the connections of rcdeploy, into the same files. Messages have the time at which they
were sent, by the clock of their host, and that at which they came here. What a connection cannot take is lost, and
counted for each host. A host that was lost is heard again once it is back.

{EXIT_STATUS}
"""

_LOOK = 0.1
"""Seconds between two looks at the recording."""

_TURN = 0.0005
"""Seconds that a thread may run Python while another one waits to do so. Python's default is ten times as long."""

_UNITS = {"kB": 1e3, "MB": 1e6, "GB": 1e9, "s": 1.0, "min": 60.0, "h": 3600.0}


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description = "Record topics into a folder with MCAP files, until Ctrl-C."
    to.epilog = _EXAMPLES
    completed(to.add_argument("topics", nargs="*", metavar="NAME", help=TOPIC), What.TOPIC)
    add_definitions(to)
    to.add_argument("-o", dest="folder", type=Path, metavar="FOLDER", help="a new folder (default: recording-TIME)")
    to.add_argument(
        "--for",
        dest="seconds",
        type=positive,
        metavar="SECONDS",
        help="end after this time, counted from the first topic",
    )
    to.add_argument("--calls", action="store_true", help="also queries and commands, with their answers and durations")
    to.add_argument("--served", action="store_true", help="with --calls: as servers report them, not clients")
    to.add_argument("--logs", action="store_true", help="also what all components log")
    add_splitting(to)
    add_compress(to)
    about = "names of types: those of ROS 2, or with omgidl those of the IDSL (default: ros2msg)"
    to.add_argument("--schema", choices=("ros2msg", "omgidl"), default="ros2msg", help=about)
    add_waiting(to)
    add_hosts(to)
    add_middleware(to)
    add_json(to)


def add_splitting(to: argparse.ArgumentParser) -> None:
    to.add_argument("--split", type=split, metavar="SIZE|TIME", help="begin a further file: 500MB, 1GB, 60s, 10min, 1h")
    to.add_argument("--keep", type=count, metavar="COUNT", help="keep only the last files; needs --split")


def add_compress(to: argparse.ArgumentParser) -> None:
    about = "make files smaller; zstd makes the smallest ones and takes the most time (default: none)"
    to.add_argument("--compress", choices=("none", "lz4", "zstd"), default="none", help=about)


def split(text: str) -> tuple[int | None, float | None]:
    """Octets or seconds after which a further file begins."""
    found = re.fullmatch(r"(\d+(?:\.\d+)?)(kB|MB|GB|s|min|h)", text)
    if not found or not float(found[1]):
        raise argparse.ArgumentTypeError(f"`{text}` is neither a size nor a time; write it as 500MB, 1GB, 60s or 10min")
    amount = float(found[1]) * _UNITS[found[2]]
    return (int(amount), None) if found[2].endswith("B") else (None, amount)


def run(options: argparse.Namespace) -> int:
    from ..errors import ConfigurationError
    from ..tools.recording.bag import Options
    from ..tools.recording.writer import Recorder

    with reported("rc record") as code, hosts_of(options) as hosts:
        if options.keep and not options.split:
            raise ConfigurationError("--keep needs --split, as in `--split 1GB --keep 10`")
        if options.served and not options.calls:
            raise ConfigurationError("--served is for --calls")
        octets, seconds = options.split or (None, None)
        how = Options(options.compress, options.schema, octets, seconds, options.keep)
        folder = options.folder or Path(time.strftime("recording-%Y-%m-%d-%H-%M-%S"))
        unreachable: dict[str, str] = {}
        with Recorder(folder, how) as recorder:
            _fill(recorder, hosts, unreachable, options)
        if recorder.error:
            raise recorder.error
        return UNREACHABLE if unreachable else FINE
    return code()


def _fill(recorder: Recorder, hosts: Hosts, unreachable: dict[str, str], options: argparse.Namespace) -> None:
    """Record until the end, and tell what has been recorded. Notes why hosts were `unreachable` in between."""
    from ..definitions import Definitions
    from ..tools.access import Access
    from ..tools.recording.session import Session
    from ..tools.recording.tellers import Tellers

    begun = time.monotonic()
    definitions = Definitions(options.include)
    recording: _Recording | None = None

    def census() -> Network:
        found = hosts.renew().census(options.middleware, own=bool(options.topics))
        unreachable.update(hosts.lost)
        return found.complete(definitions.search)

    try:
        with Access() as access:
            asked = {"calls": options.calls, "logs": options.logs, "served": options.served}
            tellers = Tellers(recorder, access, options.topics, _tell, **asked)
            session = Session(recorder, access, census, options.topics, _tell, tellers.look)
            recording = _Recording(recorder, session, tellers, unreachable)
            with contextlib.closing(tellers), Progress("rc record") as progress, _receiving_first():
                _record(recording, options, begun, census, progress)
    finally:
        recorder.close()
        if recording and recording.has_begun:
            _sum_up(recording, time.monotonic() - begun, as_json=options.json)
        elif not recorder.error:
            with contextlib.suppress(OSError):  # it is left to the user if it is in use
                recorder.discard()


@contextlib.contextmanager
def _receiving_first() -> Iterator[None]:
    """While entered, a thread that receives messages does not wait long for the one that writes: middlewares keep only
    few messages in the meantime."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(_TURN)
    try:
        yield
    finally:
        sys.setswitchinterval(before)
        gc.unfreeze()


@dataclass(frozen=True)
class _Recording:
    recorder: Recorder
    session: Session
    tellers: Tellers
    unreachable: Mapping[str, str]
    """The hosts that were out of reach for some time, and why."""

    @property
    def has_begun(self) -> bool:
        return bool(self.session.followed or self.tellers.all)

    @property
    def tracks(self) -> list[Track]:
        """Of all topics so far."""
        return [*(each.track for each in self.session.followed), *(track for _, track in self.tellers.tracks)]

    @property
    def lost(self) -> int:
        on_their_way = [*(each.lost for each in self.session.followed), *(each.lost for each in self.tellers.all)]
        return sum(on_their_way) + sum(each.dropped for each in self.tracks)


def _record(
    recording: _Recording, options: argparse.Namespace, begun: float, look: Callable[[], Network], progress: Progress
) -> None:
    from ..errors import HostUnreachable
    from ..spelling import and_then

    shown, end = begun, None
    while not recording.recorder.error:
        now = time.monotonic()
        if end and now >= end:
            break
        recording.session.look()
        if recording.has_begun and not gc.get_freeze_count():
            gc.freeze()  # to search all modules again takes 50 ms and more, in which nothing is received
        if recording.has_begun and options.seconds and end is None:
            end = time.monotonic() + options.seconds
        if not recording.has_begun and now - begun >= options.timeout:
            if lost := recording.unreachable:
                raise HostUnreachable(and_then(_nothing(options, look()), f"it may be on {', '.join(lost)}"))
            raise Absent(_nothing(options, look()))
        if not recording.has_begun and now - shown >= 1:
            shown = now
            progress.show(f"waiting up to {options.timeout:g} s: {_nothing(options, look())}")
        elif now - shown >= 1 and sys.stderr.isatty():
            shown = now
            _show(recording, now - begun)
        time.sleep(_LOOK)


def _nothing(options: argparse.Namespace, network: Network) -> str:
    reported = [what for what, wanted in (("calls", options.calls), ("log records", options.logs)) if wanted]
    also = f", and no component reports {' or '.join(reported)}" if reported else ""
    return nothing_published(network, options.topics, also)


def _tell(text: str) -> None:
    say(f"{_CLEARED}rc record", text)


_CLEARED = "\r\x1b[K" if sys.stderr.isatty() else ""
"""Clears the line that shows the progress."""


def _show(recording: _Recording, seconds: float) -> None:
    tracks, lost, recorder = recording.tracks, recording.lost, recording.recorder
    messages = sum(each.received for each in tracks)
    told = f"{seconds:.0f} s, {counted(len(tracks), 'topic')}, {counted(messages, 'message')}, {size(recorder.octets)}"
    waiting = f", {size(recorder.waiting)} wait" if recorder.waiting > 1e6 else ""
    print(f"\r\x1b[K{told}{waiting}{f', {lost} lost' if lost else ''}", end="", file=sys.stderr, flush=True)


def _sum_up(recording: _Recording, seconds: float, *, as_json: bool) -> None:
    recorder = recording.recorder
    topics = [
        _told(each.channel.name, each.track, each.lost, each.unreadable) | {"host": each.host}
        for each in sorted(recording.session.followed, key=lambda each: each.channel.name)
    ]
    topics += [
        _told(name, track, 0, track.malformed) | {"host": ""} for name, track in sorted(recording.tellers.tracks)
    ]
    tellers = [
        {
            "component": each.component,
            "host": each.host,
            "tells": each.what,
            "told": each.told,
            "lost": each.lost,
            "unreadable": each.unreadable,
            "unknown": each.unknown,
        }
        for each in recording.tellers.all
    ]
    if as_json:
        told: dict[str, Any] = {"folder": str(recorder.folder), "seconds": seconds, "octets": recorder.octets}
        hosts = list(_by_host(recording, topics, tellers))
        print(json.dumps({**told, "topics": topics, "tellers": tellers, "hosts": hosts}), flush=True)
        return
    messages = sum(each.written for each in recording.tracks)
    print(
        f"{_CLEARED}{recorder.folder}: {counted(messages, 'message')} of {counted(len(topics), 'topic')}, "
        f"{size(recorder.octets)}, {seconds:.1f} s",
        flush=True,
    )
    several = Counter(each["channel"] for each in topics)
    for told in topics:
        of = f" of {told['host']}" if told["host"] and several[told["channel"]] > 1 else ""
        print(f"  {told['channel']}{of}: {counted(told['messages'], 'message')}{_losses(told)}", flush=True)
    for told in tellers:
        if losses := _losses(told):
            print(f"  {told['component']} told {told['told']} {told['tells']}{losses}", flush=True)
    for told in _by_host(recording, topics, tellers):
        why = f"; it was out of reach: {told['unreachable']}" if told["unreachable"] else ""
        print(f"  from {told['host']}: {counted(told['messages'], 'message')}{_losses(told)}{why}", flush=True)


def _by_host(
    recording: _Recording, topics: list[dict[str, Any]], tellers: list[dict[str, Any]]
) -> Iterator[dict[str, Any]]:
    """What came of each other host, and what was lost of it."""
    for host in sorted({each["host"] for each in (*topics, *tellers)} | set(recording.unreachable)):
        if host:
            heard = [each for each in topics if each["host"] == host]
            told = [each for each in tellers if each["host"] == host]
            yield {
                "host": host,
                "messages": sum(each["messages"] for each in heard) + sum(each["told"] for each in told),
                "lost": sum(each["lost"] for each in (*heard, *told)),
                "dropped": sum(each["dropped"] for each in heard),
                "unreachable": recording.unreachable.get(host, ""),
            }


def _told(name: str, track: Track, lost: int, unreadable: int) -> dict[str, Any]:
    return {
        "channel": name,
        "messages": track.written,
        "lost": lost,
        "dropped": track.dropped,
        "unreadable": unreadable,
    }


def _losses(told: dict[str, Any]) -> str:
    parts = {
        "lost": "lost on their way",
        "dropped": "dropped here, because the disk was too slow or full",
        "unreadable": "not understood",
        "unknown": "of operations that are not announced",
    }
    found = [f"{told[name]} {what}" for name, what in parts.items() if told.get(name)]
    return f"; {', '.join(found)}" if found else ""


def size(octets: float) -> str:
    for unit in ("GB", "MB", "kB"):
        if octets >= _UNITS[unit]:
            return f"{octets / _UNITS[unit]:.1f} {unit}"
    return f"{octets:.0f} B"
