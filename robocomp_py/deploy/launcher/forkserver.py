"""The program of the fork server: it imports everything that components need, once, and forks them.

    … forkserver CHANNEL LIFELINE MIDDLEWARE… PADDING

Each datagram on the channel, a socket, is a request, with the pipe for the output. The answer is the id of the new
process, or why there is none. The new process is a grandchild whose parent has ended. So the launcher adopts it (see
`birth.adopt_orphans`) and reaps it; the process ends with the launcher, but not with the fork server.

The fork server does nothing that a new process would have to undo: it starts no thread, makes no socket or context,
handles no signal and configures no logging. It ends when the channel closes.
"""

from __future__ import annotations

import codecs
import contextlib
import gc
import importlib
import io
import json
import os
import select
import signal
import socket
import sys
from collections.abc import Mapping, Sequence
from typing import Any

from ... import installed
from ...contract.component import Component
from ...errors import ConfigurationError
from ...runtime import commonbehavior, introspecting
from ...runtime.calls import type_of
from ...runtime.commandline import prepare, read_plain
from ...runtime.worker import Worker
from ...transports.base import find_transport
from ...transports.deployment import Near, deployments
from . import unsafe
from .birth import PADDING, Birth, lifeline_of_its_own

PROGRAM = "robocomp_py.cli.rc"

_NEEDED = (
    *(PROGRAM, "robocomp_py.cli.run"),
    *(f"robocomp_py.runtime.{name}" for name in ("api", "document", "load", "records", "run", "together")),
    *(f"robocomp_py.wire.{name}" for name in ("identity", "messagepack", "packed_arrays", "layouts")),
    "numpy.random",
    "subprocess",
)
"""What `rc run`, components and the codecs of transports import."""

_MAX = 1 << 18
"""Bytes of a request."""

_BROOD = 8
"""Maximum number of processes forked from one process in between; the first of them waits for the last."""

_WORDS_OF_CHANCE = 624
"""The state of the generator that numpy's functions use."""


def main() -> None:
    channel, lifeline = socket.socket(fileno=int(sys.argv[1])), int(sys.argv[2])
    get_ready(sys.argv[3:-1])
    shared = frozenset(sys.modules)
    shown = unsafe.room_of_command(len(PADDING))
    with installed.asked_once():  # installed packages are looked up once, for all
        request = serve(channel, lifeline)
        if request is None:
            return
        try:
            code = become(request, shown)
        except SystemExit as exc:
            if exc.code is not None and not isinstance(exc.code, int):
                raise  # Python prints it
            code = exc.code or 0
        unsafe.end(code, shared)


def get_ready(middlewares: Sequence[str]) -> None:
    """Import all that components need, and do once what each of them would repeat."""
    for module in _NEEDED:
        importlib.import_module(module)
    for name in middlewares:
        with contextlib.suppress(ConfigurationError):  # its components tell that
            find_transport(name)
    codecs.lookup("utf-8-sig")
    inside = (name for name, each in deployments().items() if each.near is Near.PROCESS)
    _rehearse(middlewares[0] if middlewares else next(inside))
    unsafe.prctl(unsafe.PR_SET_MEMORY_MERGE, 1)  # if the administrator has the kernel look for pages that are equal
    gc.collect()
    gc.freeze()  # what is there now is not looked at, and so stays shared
    _stop_threads()


def _stop_threads() -> None:
    """Numpy's library starts threads when it is imported, and stops them at the first fork."""
    child = os.fork()
    if not child:
        os._exit(0)
    os.waitpid(child, 0)


def _rehearse(carrier: str) -> None:
    """Begin as a component does, without any effect: what is computed at the first time only is computed here."""

    class Nothing(Worker[None]):
        component = Component("nothing", ports=())
        middleware = carrier

    with contextlib.suppress(ConfigurationError):  # by something in the environment; components tell that
        options = read_plain(["--name", "nothing", "--set", "component.period=1.0"])
        assert options is not None
        prepare(Nothing, options)
    for own in (commonbehavior.port_of(Nothing.component), introspecting.port_of(Nothing.component)):
        assert own is not None
        for operation, pattern in own.interface.under(own.verb):
            type_of(operation, pattern)


def serve(channel: socket.socket, lifeline: int) -> Mapping[str, Any] | None:
    """Answer requests until the channel closes; returns None then, and a request in the process that is to do it.

    As little as possible is done here: each page that is written is copied for the processes forked before.
    """
    while True:
        message, pipes, _, _ = socket.recv_fds(channel, _MAX, 4)
        if not message:
            return None
        if threads() > 1:  # a lock held by another thread would never be released
            _answer(channel, json.loads(message), error="the fork server has threads")
        else:
            try:
                middle = unsafe.fork()
            except OSError as exc:
                _answer(channel, json.loads(message), error=exc.strerror)
            else:
                if not middle:
                    return _bear(channel, lifeline, message, pipes)
                os.waitpid(middle, 0)
        for pipe in pipes:
            os.close(pipe)


def threads() -> int:
    return os.stat("/proc/self/task").st_nlink - 2  # the link count of a folder is two more than its subfolders


def _bear(channel: socket.socket, lifeline: int, message: bytes, pipes: list[int]) -> Mapping[str, Any]:
    """In the process in between: start a new one, report its id, and leave it to the launcher. Returns in the new one.

    It also starts others that have been requested: they share the memory pages that this process had to copy.
    """
    middle = os.getpid()
    for more in reversed(range(_BROOD)):
        request = json.loads(message)
        try:
            born = os.fork()
        except OSError as exc:
            _answer(channel, request, error=exc.strerror)
            break
        if not born:
            channel.close()
            return _born(middle, lifeline, request, pipes)
        if not _answer(channel, request, pid=born):  # it would be started again, or was stopped before it started
            os.kill(born, signal.SIGKILL)
            os.waitpid(born, 0)
            break
        for pipe in pipes:
            os.close(pipe)
        message, pipes = _asked_already(channel) if more else (b"", [])
        if not message:
            break
    os._exit(0)


def _asked_already(channel: socket.socket) -> tuple[bytes, list[int]]:
    """The next request, with its pipe; empty if there is none yet, or if the launcher has gone."""
    with contextlib.suppress(OSError):
        if _is_readable(channel.fileno(), 0):
            message, pipes, _, _ = socket.recv_fds(channel, _MAX, 4)
            return message, pipes
    return b"", []


def _born(middle: int, lifeline: int, request: Mapping[str, Any], pipes: list[int]) -> Mapping[str, Any]:
    """In the new process: run the component, once the process in between has ended."""
    with contextlib.suppress(ProcessLookupError):
        its_end = os.pidfd_open(middle)
        if os.getppid() == middle:
            _is_readable(its_end, None)  # without a deadline: the kernel alone reports it
        os.close(its_end)
    with contextlib.suppress(BaseException):
        Birth(**request["birth"] | {"lifeline": lifeline_of_its_own(lifeline)}).prepare()
        for descriptor in (1, 2):
            os.dup2(pipes[0], descriptor)
        for each in (*pipes, lifeline):
            os.close(each)
        return request
    os._exit(127)


def _is_readable(descriptor: int, milliseconds: int | None) -> bool:
    looking = select.poll()
    looking.register(descriptor, select.POLLIN)
    return bool(looking.poll(milliseconds))


def _answer(channel: socket.socket, request: Mapping[str, Any], **told: Any) -> bool:
    """Report it; false if the launcher has gone."""
    try:
        channel.send(json.dumps({"id": request["id"], **told}).encode())
    except OSError:
        return False
    return True


def become(request: Mapping[str, Any], shown: tuple[int, int]) -> int:
    """Behave like a process started with this command: `python -m robocomp_py.cli.rc …`. Returns its exit code.

    `shown` is the address of the visible command line. This runs in each of many processes, and each function that is
    called for the first time costs some pages of memory, so it calls few.
    """
    _renew_output()
    arguments: list[str] = request["arguments"]
    try:
        os.chdir(request["cwd"])
    except OSError as exc:
        print(f"{request['cwd']}: {exc.strerror}", file=sys.stderr)
        return 1
    for name, value in request["env"].items():
        os.environ[name] = value
    os.environ["WATCHDOG_PID"] = str(os.getpid())
    program = sys.modules[PROGRAM]
    sys.argv = [str(program.__file__), *arguments]
    sys.path.insert(0, request["cwd"])
    signal.signal(signal.SIGINT, signal.default_int_handler)
    _begin_anew(sys.modules["numpy"])
    unsafe.show_command([sys.executable, "-m", PROGRAM, *arguments], request["name"], *shown)
    program.__name__, sys.modules["__main__"] = "__main__", program
    code: int = program.main()
    return code


def _renew_output() -> None:
    """Open standard output and error again, unbuffered: their descriptors have been replaced."""
    for number, stream in ((1, "stdout"), (2, "stderr")):
        before: io.TextIOWrapper = getattr(sys, stream)
        raw = io.FileIO(number, "w", closefd=False)
        raw.name = f"<{stream}>"
        renewed = io.TextIOWrapper(raw, before.encoding, before.errors, write_through=True)
        setattr(sys, stream, renewed)
        setattr(sys, f"__{stream}__", renewed)


def _begin_anew(numpy: Any) -> None:
    """Seed numpy.random for this process; Python reseeds its own generator.

    Like `seed()`, which takes twice the time.
    """
    key = numpy.frombuffer(os.urandom(4 * _WORDS_OF_CHANCE), numpy.uint32)
    numpy.random.set_state(("MT19937", key, _WORDS_OF_CHANCE))


if __name__ == "__main__":
    main()
