"""Several components in one process, each on its own thread: the implementation of `rc run DIR … + DIR …`.

Components start in the given order, without waiting for each other. One with `--after NAME` starts when that other
component is ready. The process reports that it is ready when all components are. If a component ends normally, the
others go on; if one fails, all are stopped. They are stopped one after the other, the last one first.
"""

from __future__ import annotations

import argparse
import logging
import os
import signal
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from queue import Empty, SimpleQueue
from typing import Any

from .. import installed
from ..errors import ComponentError, ConfigurationError
from ..spelling import unknown
from ..threads import NO_THREAD, start_thread
from .commandline import exit_code, log_records, parser_of, prepare, tell_notes, tell_where_on_abort
from .ending import STUCK, end_after, grace_of, settle
from .notify import CONTRACT, ENDED, notify
from .run import Running
from .settings import Document, Settings
from .signals import Signals
from .unsafe import write_out
from .watchdog import Watchdog
from .worker import Worker

log = logging.getLogger("robocomp.worker")

_REMIND = 5.0
"""Seconds between messages that name the components that one waits for."""

_STATUS = "STATUS="

Part = tuple[type[Worker[Any]], Sequence[str]]
"""A component, and its arguments."""


@dataclass
class Member:
    """One of several components. It starts when those named in `after` are ready."""

    running: Running
    after: tuple[str, ...] = ()
    thread: threading.Thread = field(default_factory=threading.Thread)

    @property
    def name(self) -> str:
        return self.running.settings.instance


_LOOK_S = 0.5
"""Longest wait in seconds. Between waits Python handles signals: one just before a wait does not interrupt it."""


class Together:
    """Components of one process, from the start of the first to the end of the last.

    `tell` sends status messages to the launcher of the process.
    """

    def __init__(self, tell: Callable[[str], None] = notify) -> None:
        self._tell = tell
        self._members: list[Member] = []
        self._changed = threading.Condition()
        self._ready: set[str] = set()
        self._ended: set[str] = set()
        self._stopping = False
        self._is_up = False
        self._statuses: dict[str, str] = {}
        """By component, those that are not empty."""
        self._news: SimpleQueue[tuple[Member, bool] | None] = SimpleQueue()
        """A component that has ended, and whether without failure; None is the request to stop all."""

    def add(self, worker_class: type[Worker[Any]], settings: Settings, after: Sequence[str] = ()) -> Member:
        """Add a component, before `run`. Raises ComponentError if its worker cannot be created."""
        running = Running(worker_class, settings, tell=partial(self._told, settings.instance))
        member = Member(running, tuple(after))
        member.thread = threading.Thread(target=self._live, args=(member,), name=member.name)
        self._members.append(member)
        return member

    @property
    def every(self) -> list[Running]:
        return [member.running for member in self._members]

    def run(self) -> bool:
        """Run until the last one has ended. Returns False if any failed."""
        self._tell_ready()
        for member in self._members:
            if not start_thread(member.thread):
                log.error("%s: %s", member.name, NO_THREAD)
                self._news.put((member, False))
        fine = True
        while len(self._ended) < len(self._members):
            try:
                news = self._news.get(timeout=_LOOK_S)
            except Empty:
                continue
            if news is None:
                self._stop()
                continue
            member, went_well = news
            self._note_end(member)
            if not went_well:
                fine = False
                self._stop()
        for member in self._members:
            if member.thread.ident is not None:
                member.thread.join()
        return fine

    def stop(self) -> None:
        """Ask all components to stop. May be called from any thread."""
        self._news.put(None)

    def speaking(self, record: logging.LogRecord) -> Member | None:
        """The component that logs a record, called on its thread; None if it is unknown."""
        here = threading.current_thread()
        ways: tuple[Callable[[Member], bool], ...] = (
            lambda member: record.name == member.name,
            lambda member: member.running.is_running_here,  # possibly on a thread of a component that calls it
            lambda member: member.thread is here,
        )
        return next((member for is_it in ways for member in self._members if is_it(member)), None)

    # Called on the thread of a component.

    def _live(self, member: Member) -> None:
        fine = False
        try:
            fine = member.running.run() if self._may_begin(member) else self._stopping
        except Exception:
            log.exception("%s failed", member.name)
        finally:
            self._news.put((member, fine))

    def _may_begin(self, member: Member) -> bool:
        """Wait for the components in `after`. False if one of them has ended, or if all components are stopping."""
        with self._changed:
            while not self._stopping:
                missing = [name for name in member.after if name not in self._ready]
                if not missing:
                    return True
                gone = [name for name in missing if name in self._ended]
                if gone:
                    log.error("%s ended before it was ready, so %s does not start", gone[0], member.name)
                    return False
                if not self._changed.wait(_REMIND):
                    log.info("waiting until %s is ready", ", ".join(missing))
            return False

    def _told(self, name: str, text: str) -> None:
        """Handle a status message of one component: the process is ready when all components are."""
        if text.startswith(CONTRACT):
            self._tell(text)
        elif text.startswith(_STATUS):
            with self._changed:
                self._statuses[name] = text.removeprefix(_STATUS)
                is_up = self._is_up
            if is_up:
                self._tell(self._status())
        elif text == "READY=1":
            with self._changed:
                self._ready.add(name)
                self._changed.notify_all()
            self._tell_ready()

    def _tell_ready(self) -> None:
        """Report once that all are ready; until then, report which are not."""
        with self._changed:
            missing = [each.name for each in self._members if each.name not in self._ready | self._ended]
            is_late, self._is_up = self._is_up or self._stopping, self._is_up or not missing
        if not is_late:
            self._tell(f"STATUS=waiting for {', '.join(missing)}" if missing else f"READY=1\n{self._status()}")

    def _status(self) -> str:
        """What the components say of themselves."""
        with self._changed:
            said = [f"{name} {text}" for name, text in self._statuses.items() if text]
        return _STATUS + "; ".join(said)

    # Called on the thread of `run`.

    def _note_end(self, member: Member) -> None:
        with self._changed:
            self._ended.add(member.name)
            self._changed.notify_all()
        if self._stopping:
            return
        if len(self._ended) == len(self._members):
            self._tell("STOPPING=1")
        else:
            self._tell_ready()
            self._tell(f"{ENDED}{member.name}")

    def _stop(self) -> None:
        with self._changed:
            if self._stopping:
                return
            self._stopping = True
            self._changed.notify_all()
        self._tell("STOPPING=1")
        for member in reversed(self._members):
            member.running.stop()
            if member.thread.ident is None:
                continue  # no thread could be started for it
            member.thread.join(STUCK)
            if member.thread.is_alive():
                self._tell_stuck(member)

    def _tell_stuck(self, member: Member) -> None:
        doing = member.running.doing or "closing"
        print(
            f"{member.name} was asked to stop {STUCK:g} s ago, but is still busy with {doing}; "
            "press Ctrl-C again to end the process now",
            file=sys.stderr,
        )


@installed.asked_once()
def main(parts: Sequence[Part], missed: Callable[[], int] = lambda: 0) -> int:
    """Run components together, as a program. Returns the exit code; for `missed` see `run.main`."""
    options = [_options(worker_class, arguments) for worker_class, arguments in parts]
    together = Together()
    try:
        prepared = _prepared(parts, options)
        _configure_logging([settings for settings, _ in prepared], together)
        for _, document in prepared:
            tell_notes(document)
        for (worker_class, _), (settings, _), own in zip(parts, prepared, options, strict=True):
            try:
                together.add(worker_class, settings, own.after)
            except ComponentError as exc:
                raise ComponentError(f"{settings.instance}: {exc}") from exc
    except (ConfigurationError, ComponentError) as exc:
        print(exc, file=sys.stderr)
        return exit_code(*options)
    received: list[int] = []

    grace = grace_of([own.grace for own in options])

    def stop_by(number: int) -> None:
        end_after(grace)
        received.append(number)
        together.stop()

    try:
        wishes = [settings.watchdog for settings, _ in prepared]
        with Signals(stop_by, partial(end_after, grace)), Watchdog(together.every, wishes, notify):
            if number := missed():
                stop_by(number)
            front = next((each.worker._in_front for each in together.every if each.worker._in_front), None)
            fine = front(together.run, together.stop) if front else together.run()
            write_out()
        settle()
    except ComponentError as exc:
        print(exc, file=sys.stderr)
        return 1
    except KeyboardInterrupt:  # the second one: what the components' threads do cannot be interrupted
        logging.shutdown()
        sys.stdout.flush()
        os._exit(128 + signal.SIGINT)
    return 1 if not fine else 128 + received[0] if received else 0


def _options(worker_class: type[Worker[Any]], arguments: Sequence[str]) -> argparse.Namespace:
    parser = parser_of(worker_class.component)
    parser.add_argument(
        "--after", action="append", default=[], metavar="NAME", help="start when this other component is ready"
    )
    options = parser.parse_args(arguments)
    if options.json:
        parser.error("--json is for --print-config, which is for one component")
    if options.print_config:
        parser.error("--print-config is for one component, without a `+`")
    return options


def _prepared(parts: Sequence[Part], options: Sequence[argparse.Namespace]) -> list[tuple[Settings, Document]]:
    """The settings of all components with their documents. Raises ConfigurationError with all mistakes."""
    prepared: dict[str, tuple[Settings, Document]] = {}
    wrong: list[str] = []
    blamed: dict[str, list[str]] = {}
    for (worker_class, _), own in zip(parts, options, strict=True):
        try:
            settings, document = prepare(worker_class, own)
        except ConfigurationError as exc:
            blamed.setdefault(str(exc), []).append(own.name or worker_class.component.name)
            continue
        if settings.instance in prepared:
            wrong.append(f"two components of the process are named `{settings.instance}`; give each its own --name")
        prepared[settings.instance] = settings, document
    wrong = [*(f"{', '.join(names)}: {message}" for message, names in blamed.items()), *wrong]
    if not wrong:
        after = {name: own.after for name, own in zip(prepared, options, strict=True)}
        wrong = [f"{name}: --after: {each}" for name in after for each in _never(name, after)]
    if wrong:
        raise ConfigurationError("\n".join(wrong))
    return list(prepared.values())


def _never(name: str, after: Mapping[str, Sequence[str]]) -> list[str]:
    """The reasons why a component would never start; empty if there are none."""
    absent = [unknown("instance", other, after) for other in after[name] if other not in after]
    if absent:
        return absent
    waits_for, new = set(after[name]), True
    while new:
        found = {other for each in waits_for for other in after.get(each, ())}
        new = not found <= waits_for
        waits_for |= found
    return [f"`{name}` waits for itself"] if name in waits_for else []


class _ComponentName(logging.Filter):
    """Adds the name of the component to log records, and drops records below the log level of that component."""

    def __init__(self, together: Together, behind: str) -> None:
        super().__init__()
        self._together, self._behind = together, behind

    def filter(self, record: logging.LogRecord) -> bool:
        member = self._together.speaking(record)
        record.instance = member.name if member else ""
        record.speaker = f"{member.name}{self._behind}" if member else ""
        return member is None or record.levelno >= _level(member.running.settings)


def _configure_logging(every: Sequence[Settings], together: Together) -> None:
    tell_where_on_abort()
    launched = "NOTIFY_SOCKET" in os.environ  # then the launcher adds the time
    form = "%(levelname)s: %(speaker)s%(message)s" if launched else "%(asctime)s %(speaker)s%(levelname)s: %(message)s"
    logging.basicConfig(level=min(map(_level, every)), format=form, datefmt="%H:%M:%S", stream=sys.stderr)
    for handler in logging.getLogger().handlers:
        handler.addFilter(_ComponentName(together, ": " if launched else " "))
    log_records(lambda record: getattr(record, "instance", ""))  # as the filter has found it


def _level(settings: Settings) -> int:
    return logging.getLevelNamesMapping()[settings.log.upper()]
