"""`rc lsp`: the language server, for editors. It talks over stdin and stdout."""

from __future__ import annotations

import argparse
import os
import signal
import sys
from typing import BinaryIO

from .common import FINE, USAGE, WRONG, raise_if_signalled

NAME = "lsp"


_EXAMPLES = """\
examples:
  rc lsp            what an editor starts
  rc lsp --stdio    ... the same, for editors that add this

exit status: 0 the editor has ended it, 1 the editor is gone or the server's libraries are missing, 2 usage
"""


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description = (
        "The language server for all the languages. Editors start it: docs/guides/editors.md says how, for each."
    )
    to.epilog = _EXAMPLES
    to.add_argument("--stdio", action="store_true", help="talk over stdin and stdout, as it does anyway")


def run(options: argparse.Namespace) -> int:
    try:
        from ..lsp.session import make_server
    except ModuleNotFoundError as exc:
        if exc.name not in ("pygls", "lsprotocol"):
            raise
        print("rc lsp: the language server needs pygls; run: pip install 'robocomp-py[lsp]'", file=sys.stderr)
        return WRONG
    if sys.stdin.isatty():
        print("rc lsp: editors start this, and talk to it; see docs/guides/editors.md", file=sys.stderr)
        return USAGE
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)  # no cleanup, which would wait for the thread that reads stdin
    raise_if_signalled()  # on one that came before
    return FINE if make_server().serve(*_channels()) else WRONG


def _channels() -> tuple[BinaryIO, BinaryIO]:
    """stdin and stdout, reserved for the editor: all other output goes to stderr."""
    channels = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    return channels
