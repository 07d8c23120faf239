"""`rc host`: the helper processes that the components of one machine share."""

from __future__ import annotations

import argparse
import contextlib
import sys
import threading

from .common import FINE, USAGE, complain, raise_if_signalled
from .completing import What, completed

NAME = "host"

_EXAMPLES = """\
examples:
  rc host zenoh                                           the router of this user's components
  rc host zenoh --set transports.zenoh.connect=here/net   ... the router of a network, as configured in its components
  rc host ice                                             IceStorm, like RoboComp's rcnode

exit status: 0 the middleware needs no helper, 1 the helper cannot run, 2 usage, 130/143 stopped by a signal
"""


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description = (
        "Run a helper process that the components of this machine share, until stopped. rcdeploy does this for its "
        "networks; use this command for components that are started in another way."
    )
    to.epilog = _EXAMPLES
    about = "the middleware, any that is installed; the command ends at once if it needs no helper"
    completed(to.add_argument("middleware", metavar="MIDDLEWARE", help=about), What.MIDDLEWARE)
    to.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="transports.MIDDLEWARE.KEY=VALUE",
        help="set an option of the middleware, as for a component; may be repeated",
    )


def run(options: argparse.Namespace) -> int:
    from .. import installed
    from ..errors import ConfigurationError, TransportError
    from ..runtime import settings
    from ..runtime.document import Document
    from ..runtime.notify import notify
    from ..runtime.signals import Signals
    from ..spelling import unknown
    from ..transports.base import TransportConfig, hosting

    middleware = options.middleware
    if middleware not in installed.transports():
        print(f"rc host: {unknown('middleware', middleware, installed.transports())}", file=sys.stderr)
        return USAGE
    document = Document()
    try:
        for assignment in options.set:
            settings.override(document, assignment)
            if not assignment.startswith(f"transports.{middleware}."):
                raise ConfigurationError(f"--set {assignment}: write it as transports.{middleware}.KEY=VALUE")
    except ConfigurationError as exc:
        print(f"rc host: {exc}", file=sys.stderr)
        return USAGE
    own = document.data.get("transports", {}).get(middleware, {})
    received: list[int] = []
    ended = threading.Event()

    def end(number: int) -> None:
        received.append(number)
        ended.set()

    try:
        with contextlib.ExitStack() as stack:
            stack.enter_context(Signals(end))
            raise_if_signalled()  # on a signal that came before
            stack.enter_context(hosting(middleware, TransportConfig(own, f"rc host {middleware}")))
            if not _has_helper(middleware):
                print(f"rc host: {middleware} needs no shared process", file=sys.stderr)
                return FINE
            notify("READY=1", f"STATUS=hosting {middleware}")
            print(f"rc host: {middleware}, until Ctrl-C", flush=True)
            while not ended.wait(0.5):  # a signal that arrives just before an endless wait would not end it
                pass
            notify("STOPPING=1")
    except (ConfigurationError, TransportError) as exc:
        return complain(f"rc host: {exc}")
    return 128 + received[0]


def _has_helper(middleware: str) -> bool:
    from ..transports.base import find_transport

    return hasattr(find_transport(middleware), "host")
