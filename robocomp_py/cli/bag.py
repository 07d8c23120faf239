"""`rc bag`: what is in a recording, and recordings made of recordings."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from .common import FINE, WRONG, counted, describe, print_table
from .completing import What, completed
from .live import RECORDING, add_json, positive, reported, say
from .record import add_compress, add_splitting, size

if TYPE_CHECKING:
    from ..tools.recording.bag import Options
    from ..tools.recording.reader import Recording

NAME = "bag"

_EXAMPLES = """\
examples:
  rc bag info run1                              topics, times and sizes
  rc bag mend run1 -o whole                     save what an interrupted recording holds
  rc bag cut run1 --start 5 --for 10 -o part    ten seconds of it
  rc bag cut run1 --only LaserPub -o scans      one topic of it
  rc bag merge run1 run2 -o both                two recordings as one, in the order of their times
  rc bag convert run1 --to csv -o tables        a table for each topic
  rc bag convert run1 --to omgidl -o named      with the names of the IDSL, for Foxglove
  rc bag convert run1 --to foxglove -o drawn    and with pictures, scans, poses and points that Foxglove draws

A recording is a folder that `rc record` has made, or a file *.mcap. Recordings are never changed: each command writes a
new folder.

exit status: 0 done, 1 a file is missing, broken or empty, 2 usage
"""


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description = "Look into recordings, and make new ones of them."
    to.epilog = _EXAMPLES
    commands = to.add_subparsers(dest="does", metavar="COMMAND", required=True)
    made = {name: commands.add_parser(name, help=about) for name, about in _DOES.items()}
    for name, each in made.items():
        describe(each, _DOES[name], to)
        if name == "merge":
            several = each.add_argument("recordings", nargs="+", type=Path, metavar="RECORDING", help=RECORDING)
            completed(several, ".mcap")
        else:
            completed(each.add_argument("recording", type=Path, metavar="RECORDING", help=RECORDING), ".mcap")
    for each in made.values():
        add_json(each)
    add_span(made["cut"])
    made["convert"].add_argument(
        "--to",
        required=True,
        choices=("csv", "omgidl", "ros2msg", "foxglove"),
        help="tables, other names of types, or with further topics that Foxglove's panels draw",
    )
    for name in ("cut", "convert"):
        about = "only topics of this name; repeatable"
        completed(made[name].add_argument("--only", action="append", metavar="NAME", help=about), What.RECORDED)
    for name in ("mend", "merge", "cut", "convert"):
        made[name].add_argument("-o", dest="folder", type=Path, required=True, metavar="FOLDER", help="a new folder")
        add_splitting(made[name])
        add_compress(made[name])


_DOES = {
    "info": "show topics, times and sizes of a recording",
    "mend": "save what an interrupted or damaged recording holds",
    "merge": "make one recording of several, in the order of their times",
    "cut": "copy a part of a recording",
    "convert": "write a recording in another form",
}


def add_span(to: argparse.ArgumentParser) -> None:
    """What `span_of` reads."""
    to.add_argument("--start", type=_offset, default=0.0, metavar="SECONDS", help="from then on (default: 0)")
    to.add_argument("--for", dest="seconds", type=positive, metavar="SECONDS", help="for this time (default: all)")


def span_of(options: argparse.Namespace, recording: Recording) -> tuple[int, int | None]:
    """The part of a recording that is meant: from and before, in ns since 1970."""
    start = recording.start + int(options.start * 1e9)
    return start, start + int(options.seconds * 1e9) if options.seconds else None


def _offset(text: str) -> float:
    return 0.0 if text in ("0", "0s") else positive(text)


def run(options: argparse.Namespace) -> int:
    commands: dict[str, Callable[[argparse.Namespace], int]] = {
        "info": _info,
        "mend": _mend,
        "merge": _merge,
        "cut": _cut,
        "convert": _convert,
    }
    with reported(f"rc bag {options.does}") as code:
        return commands[options.does](options)
    return code()


def _info(options: argparse.Namespace) -> int:
    from ..tools.recording.reader import Recording

    with Recording(options.recording) as recording:
        if options.json:
            print(json.dumps(_described(recording)))
        else:
            _print(recording)
    return FINE


def _described(recording: Recording) -> dict[str, object]:
    return {
        "path": str(recording.path),
        "files": [str(each.path) for each in recording.files],
        "octets": recording.octets,
        "attachments": [{"name": name, "octets": octets} for name, octets in recording.attachments],
        "start": recording.start,
        "end": recording.end,
        "topics": [
            {
                "name": name,
                "messages": recording.counts[name],
                "type": topic.type,
                "encoding": topic.encoding,
                "schema": topic.schema_encoding,
                "publisher": topic.publisher,
                "middleware": topic.middleware,
                "problem": topic.problem,
            }
            for name, topic in recording.topics.items()
        ],
    }


def _print(recording: Recording) -> None:
    from ..printable import printable

    messages = sum(recording.counts.values())
    seconds = (recording.end - recording.start) / 1e9
    files = counted(len(recording.files), "file")
    print(f"{recording.path}: {files}, {size(recording.octets)}, {counted(messages, 'message')}, {seconds:.1f} s")
    if not messages:
        return
    print(f"from {time_of(recording.start)} to {time_of(recording.end)}")
    rows = [
        (
            name,
            str(recording.counts[name]),
            f"{(recording.counts[name] - 1) / seconds:.1f} Hz" if seconds and recording.counts[name] > 1 else "",
            topic.type,
            topic.publisher,
            topic.middleware,
        )
        for name, topic in recording.topics.items()
    ]
    print_table(("topic", "messages", "rate", "type", "publisher", "over"), rows, wrapped=("topic", "type"))
    for name, octets in recording.attachments:
        print(f"attached: {printable(name)}, {size(octets)}")
    for name, topic in recording.topics.items():
        if topic.problem:
            print(f"{name}: {topic.problem}")


def time_of(ns: int) -> str:
    """An instant for people, in the time zone of this machine."""
    try:
        return datetime.fromtimestamp(ns / 1e9).strftime("%Y-%m-%d %H:%M:%S.%f")[:-3]
    except (ValueError, OverflowError, OSError):
        return f"{ns} ns"


def _mend(options: argparse.Namespace) -> int:
    from ..tools.recording.mend import mend

    found = mend(options.recording, options.folder, _writing(options))
    for each in found:
        state = "it was whole" if each.is_whole and not each.damaged else "it had no end"
        lost = [f"{counted(each.damaged, 'damaged part')} left out"] if each.damaged else []
        lost += [f"{size(each.cut)} at its end were cut"] if each.cut else []
        if each.is_whole and each.damaged:
            state = "it was damaged"
        if options.json:
            print(json.dumps(each._asdict(), default=str))
            continue
        print(f"{each.path}: {counted(each.messages, 'message')} saved; {', '.join([state, *lost])}")
    return FINE if any(each.messages for each in found) else WRONG


def _merge(options: argparse.Namespace) -> int:
    from contextlib import ExitStack

    from ..tools.recording.edit import Once, copy
    from ..tools.recording.reader import Recording

    once = Once()
    with ExitStack() as end:
        recordings = [end.enter_context(Recording(each)) for each in options.recordings]
        count = copy(recordings, options.folder, _writing(options), once=once)
    if once.repeated:
        say("rc bag merge", f"{counted(once.repeated, 'message')} of several recordings written once")
    return _told(options, count)


def _cut(options: argparse.Namespace) -> int:
    from ..tools.recording.edit import copy
    from ..tools.recording.reader import Recording

    with Recording(options.recording) as recording:
        start, end = span_of(options, recording)
        names = _chosen(recording, options.only)
        count = copy([recording], options.folder, _writing(options), names=names, start=start, end=end)
    return _told(options, count)


def _convert(options: argparse.Namespace) -> int:
    from ..tools.recording.edit import copy, write_csv
    from ..tools.recording.reader import Recording

    with Recording(options.recording) as recording:
        names = _chosen(recording, options.only)
        if options.to == "csv":
            rows, left_out = write_csv(recording, options.folder, names)
            for name, number in left_out.items():
                why = recording.topics[name].problem or "they do not fit its contract"
                say("rc bag convert", f"{name}: {counted(number, 'message')} left out: {why}")
            for path, number in rows.items():
                told = {"path": str(path), "rows": number}
                print(json.dumps(told) if options.json else f"{path}: {counted(number, 'row')}")
            if not (rows or left_out):
                say("rc bag convert", f"{options.recording} has no messages")
            return FINE if any(rows.values()) else WRONG
        if options.to == "foxglove":
            from ..tools.foxglove import need_foxglove

            need_foxglove()
            from ..tools.foxglove.drawn import Drawn

            count = copy([recording], options.folder, _writing(options), names=names, also=Drawn())
        else:
            count = copy([recording], options.folder, _writing(options, options.to), names=names, schema=options.to)
    return _told(options, count)


def _told(options: argparse.Namespace, count: int) -> int:
    if not count:
        why = ": none was in this part of the recording" if options.does == "cut" else ""
        say(f"rc bag {options.does}", f"{options.folder} has no messages{why}")
    told = {"folder": str(options.folder), "messages": count}
    print(json.dumps(told) if options.json else f"{options.folder}: {counted(count, 'message')}")
    return FINE if count else WRONG


def _writing(options: argparse.Namespace, schema: str = "ros2msg") -> Options:
    from ..errors import ConfigurationError
    from ..tools.recording.bag import Options

    if options.keep and not options.split:
        raise ConfigurationError("--keep needs --split, as in `--split 1GB --keep 10`")
    octets, seconds = options.split or (None, None)
    return Options(options.compress, schema, octets, seconds, options.keep)


def _chosen(recording: Recording, wanted: list[str] | None) -> list[str] | None:
    """The topics that these names mean, in whole or in part. Raises RecordingError."""
    from ..tools.recording.reader import named

    return [each for name in wanted for each in named(recording, name)] if wanted else None
