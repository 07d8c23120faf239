"""Commands that a signal comes to while Python ignores what that raises, or just before a wait."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

from robocomp_py.testing.patience import SOON

_LOSING = """
import signal, sys
from importlib import import_module

class Last:
    def __del__(self):
        signal.raise_signal(getattr(signal, sys.argv[1]))

program, module = (import_module(f"robocomp_py.cli.{name}") for name in sys.argv[2:4])
run = module.run

def run_afterwards(options):
    Last()
    return run(options)

module.run = run_afterwards
raise SystemExit(program.main(sys.argv[4:]))
"""

UNHEARD = """
import signal, sys, threading

def interrupt():
    sys.stdin.readline()
    signal.pthread_kill(threading.get_ident(), signal.SIGINT)

threading.Thread(target=interrupt).start()
"""
"""In front of a script: a line to it is a Ctrl-C that ends no wait, as one that comes just before that begins."""


def run_losing(
    signal: str, program: str, module: str, *arguments: str, **options: Any
) -> subprocess.CompletedProcess[str]:
    """Run a command that loses what this signal raises just before its module does anything."""
    command = [sys.executable, "-c", _LOSING, signal, program, module, *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=SOON * 3, **options)
