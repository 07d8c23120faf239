"""What launching takes from the C library and from CPython that neither offers to a program.

    what              written for            if the probe fails
    prctl             Linux 3.4 and newer    nothing is set: a process outlives its launcher until its lifeline closes
    fork              glibc, CPython 3.11    `os.fork`, which does what Python does at a fork one time more
    end               CPython 3.11 to 3.13   Python ends the process, which takes longer and copies more memory
    show_command      Linux, /proc           `ps` shows the command of the process that components are forked from

Standard library only, and ready before a fork.
"""

from __future__ import annotations

import atexit
import contextlib
import ctypes
import gc
import os
import sys
import threading
import weakref
from collections.abc import Callable, Collection
from types import ModuleType
from typing import Any, NoReturn

from ...runtime.unsafe import write_out

PR_SET_PDEATHSIG = 1
PR_SET_NAME = 15
PR_SET_CHILD_SUBREAPER = 36
PR_SET_MEMORY_MERGE = 67

_library = ctypes.PyDLL(None, use_errno=True)
_prctl: Any = getattr(_library, "prctl", None)
_fork: Any = getattr(_library, "fork", None)
_exit: Any = getattr(_library, "exit", None)
_wait_for_threads: Callable[[], None] | None = getattr(threading, "_shutdown", None)
_run_exit_functions: Callable[[], None] | None = getattr(atexit, "_run_exitfuncs", None)


def prctl(option: int, value: Any) -> None:
    if _prctl:
        _prctl(option, value, 0, 0, 0)


def fork() -> int:
    """A fork at which Python does nothing: for a process in between, which forks at once. Raises OSError."""
    if _fork is None:
        return os.fork()
    process: int = _fork()
    if process < 0:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))
    return process


def end(code: int, shared: Collection[str]) -> NoReturn:
    """End as Python ends, but without taking apart the modules that were `shared` with the others.

    Python would touch all of their memory for that, which would be copied first: it would take longer than all else
    that a component does to end. So we do what can be seen of it: wait for threads, call what is registered to be
    called, have objects of the component's own modules finalized (files are written out by that), and leave the rest
    to the C library.
    """
    if not (_wait_for_threads and _run_exit_functions and _exit):
        sys.exit(code)
    _wait_for_threads()  # it ends pools of threads, too
    _run_exit_functions()
    write_out()  # also of files that something shared knows
    gc.collect()  # what is not needed any more is finalized while its module and the files of that are there
    marks = [_marked(sys.modules.pop(name)) for name in sys.modules.keys() - shared]
    gc.collect()
    left = [there for mark in marks if (there := mark())]
    for namespace in gc.get_referrers(*left):  # once for all: it looks at every object
        if isinstance(namespace, dict):  # of a module that something shared knows
            namespace.clear()
    gc.collect()
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError):
            stream.flush()
    _exit(code)
    raise AssertionError("exit does not return")


class _Mark:
    """Lives as long as the names of a module."""


def _marked(module: object) -> weakref.ref[_Mark]:
    mark = _Mark()
    if isinstance(module, ModuleType):  # programs put other things among the modules, too
        vars(module)["__mark__"] = mark
    return weakref.ref(mark)


def room_of_command(padding: int) -> tuple[int, int]:
    """From where to where the command line lies that others see; the same places if it cannot be written.

    At least this many octets of it must be padding.
    """
    with contextlib.suppress(OSError, ValueError, IndexError), open("/proc/self/stat", "rb") as stat:
        words = stat.read().rpartition(b")")[2].split()
        begin, end = int(words[45]), int(words[46])
        if begin and padding < end - begin < 1 << 20:
            return begin, end
    return 0, 0


def show_command(command: list[str], name: str, begin: int, end: int) -> None:
    """Have `ps` show this command, if there is room for one, and `top` the name."""
    prctl(PR_SET_NAME, os.fsencode(name)[:15])
    if begin < end:
        shown = b"\0".join(map(os.fsencode, command))[: end - begin - 1]
        ctypes.memmove(begin, shown.ljust(end - begin, b"\0"), end - begin)
