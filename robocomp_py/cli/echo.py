"""`rc echo`: what is published."""

from __future__ import annotations

import argparse
import json
import sys
from datetime import datetime

from .common import FINE
from .live import EXIT_STATUS, add_topics, awaited_topics, count, nothing_heard, part, reported, shortened

NAME = "echo"
HELP = "print what is published to topics"

_EXAMPLES = f"""\
examples:
  rc echo LaserPub                          all topics of this interface
  rc echo world/BatteryStatusPub -n 1       one message of one instance
  rc echo LaserPub --field laserData[0]     only a part of each message
  rc echo LaserPub --full --json            everything, for machines

Long sequences are cut, unless --full or --json is given. No publisher waits for this command.

{EXIT_STATUS}
"""


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description = "Print the messages of topics as they arrive, until Ctrl-C."
    to.epilog = _EXAMPLES
    to.formatter_class = argparse.RawDescriptionHelpFormatter
    to.add_argument("--field", metavar="PATH", help="print only this part: a.b, or a.b[0]")
    to.add_argument("--full", action="store_true", help="print long sequences whole")
    to.add_argument("-n", dest="most", type=count, metavar="COUNT", help="end after this number of messages")
    add_topics(to)


def run(options: argparse.Namespace) -> int:
    from ..tools.tap import tapped

    with reported("rc echo") as code:
        topics = awaited_topics(options)
        several = len(topics) > 1 or options.json
        printed = 0
        for heard in tapped(topics, first=options.timeout, whole=options.seconds):
            if heard.dropped:
                why = "they come faster than they are printed"
                print(f"rc echo: {heard.dropped} messages were dropped here: {why}", file=sys.stderr)
            message = part(heard.message, options.field) if options.field else heard.message
            if options.json:
                print(json.dumps({"time": heard.time, "channel": heard.channel, "message": message}), flush=True)
            else:
                at = datetime.fromtimestamp(heard.time).strftime("%H:%M:%S.%f")[:-3]
                text = json.dumps(message if options.full else shortened(message), ensure_ascii=False)
                print(at, *([heard.channel] if several else []), text, flush=True)
            printed += 1
            if printed == options.most:
                break
        if not printed:
            raise nothing_heard(options)
        return FINE
    return code()
