"""`rc foxglove`: shows a running network, or a recording, in Foxglove."""

from __future__ import annotations

import argparse
import contextlib
import math
import time
from pathlib import Path
from typing import TYPE_CHECKING

from .common import FINE
from .completing import What, completed
from .hosts import add_hosts, hosts_of
from .live import (
    EXIT_STATUS,
    TOPIC,
    Absent,
    add_definitions,
    add_middleware,
    nothing_published,
    port,
    positive,
    reported,
    say,
)

if TYPE_CHECKING:
    from ..tools.foxglove.live import Bridge
    from ..tools.hosts import Hosts
    from ..tools.network import Network

NAME = "foxglove"

_EXAMPLES = f"""\
examples:
  rc foxglove                        all topics, also those that appear later, until Ctrl-C
  rc foxglove LaserPub camera        only these
  rc foxglove --network rescue       only those of a network that rcdeploy runs, on all its hosts
  rc foxglove run1/run1_0.mcap       a recording, as it was in time
  rc foxglove run1                   the same for a folder of `rc record`
  rc foxglove --port 9000            at another port than 8765

Open the printed address in Foxglove: Open connection, Foxglove WebSocket. Only programs on this host can connect. It
needs: pip install 'robocomp-py[foxglove]'

{EXIT_STATUS}
"""

_MCAP = ".mcap"

_LOOK = 0.1
"""Seconds between two looks for new topics, and at the end."""


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description = (
        "Serve topics to Foxglove: each as `rc record` writes it, and beside it pictures, scans, poses and points as "
        "Foxglove's panels draw them. No publisher waits for this command."
    )
    to.epilog = _EXAMPLES
    names = to.add_argument("topics", nargs="*", metavar="NAME", help=f"{TOPIC}; or a recording: a folder, or *.mcap")
    completed(names, What.TOPIC)
    add_definitions(to)
    about = "only topics of a network that rcdeploy runs here, by its name or file, on all its hosts"
    completed(to.add_argument("--network", metavar="NET", help=about), What.NETWORK)
    about = "a folder of `rc record`, or a file *.mcap, instead of what runs"
    completed(to.add_argument("--recording", type=Path, metavar="RECORDING", help=about), ".mcap")
    add_hosts(to, network=False)
    to.add_argument("--port", type=port, default=8765, metavar="PORT", help="0: any that is free (default: 8765)")
    to.add_argument("--for", dest="seconds", type=positive, metavar="SECONDS", help="end after this time")
    add_middleware(to)


def run(options: argparse.Namespace) -> int:
    from ..tools.foxglove import need_foxglove

    with reported("rc foxglove") as code:
        need_foxglove()
        _take_recording(options)
        from ..tools.foxglove.live import Bridge

        looking = contextlib.nullcontext() if options.recording else hosts_of(options)
        with looking as hosts, Bridge("robocomp", options.port) as bridge:
            end = time.monotonic() + options.seconds if options.seconds else math.inf
            if hosts is None:
                _show_recording(bridge, options, end)
            else:
                _show_network(bridge, options, hosts, end)
        return FINE
    return code()


def _take_recording(options: argparse.Namespace) -> None:
    """A name that ends with `.mcap`, or is a folder with such files, is a recording. Raises ConfigurationError."""
    from ..errors import ConfigurationError

    files = [each for each in options.topics if each.endswith(_MCAP) or any(Path(each).glob(f"*{_MCAP}"))]
    if len(files) + bool(options.recording) > 1:
        raise ConfigurationError("one recording at a time is shown; `rc bag merge` makes one of several")
    if files:
        options.recording = Path(files[0])
        options.topics.remove(files[0])
    if options.recording and options.network:
        raise ConfigurationError("--network is for what runs, and a recording does not")


def _show_network(bridge: Bridge, options: argparse.Namespace, hosts: Hosts, end: float) -> None:
    from ..definitions import Definitions
    from ..tools.access import Access
    from ..tools.recording.session import Session

    definitions = Definitions(options.include)

    def census() -> Network:
        """What runs on all hosts, or of it what belongs to the network that is wanted."""
        found = hosts.renew().census(options.middleware, own=bool(options.topics)).complete(definitions.search)
        return found.only(hosts.instances) if options.network else found

    with Access() as access:
        session = Session(bridge, access, census, options.topics, _tell)
        session.look()
        _tell_address(bridge)
        if not session.followed:
            _tell(nothing_published(census(), options.topics, " yet"))
        while time.monotonic() < end:
            session.look()
            time.sleep(_LOOK)


def _show_recording(bridge: Bridge, options: argparse.Namespace, end: float) -> None:
    """Its topics stay to be looked at until the end, or Ctrl-C, with the last message of each."""
    from ..tools.recording.layout import Topic
    from ..tools.recording.reader import Recording, named

    with Recording(options.recording) as recording:
        chosen = {each for name in options.topics for each in named(recording, name)} or set(recording.topics)
        tracks = {}
        for name in sorted(chosen):
            topic = recording.topics[name]
            if topic.operation is None or topic.problem:
                _tell(f"{name}: {topic.problem}")
                continue
            tracks[name] = bridge.track(Topic(name, topic.operation, topic.publisher), bytes)
        if not tracks:
            raise Absent(f"{options.recording} has no topic that can be shown")
        _tell_address(bridge)
        begun = time.monotonic()
        for message in recording.messages(list(tracks)):
            due = begun + (message.log_time - recording.start) / 1e9
            while (now := time.monotonic()) < due and now < end:
                time.sleep(min(_LOOK, due - now, end - now))
            if time.monotonic() >= end:
                return
            tracks[message.topic.name].put(message.data, message.publish_time, message.sequence)
        while time.monotonic() < end:
            time.sleep(min(_LOOK, end - time.monotonic()))


def _tell_address(bridge: Bridge) -> None:
    """Once the topics are advertised: the library refuses a client that subscribes to one within milliseconds."""
    print(f"rc foxglove: {bridge.address}, until Ctrl-C", flush=True)


def _tell(text: str) -> None:
    say("rc foxglove", text)
