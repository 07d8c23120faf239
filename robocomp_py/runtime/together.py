"""Several components in one process, each on a thread of its own: what `rc run DIR … + DIR …` runs.

They begin in the order in which they are given, without waiting for each other: each becomes visible, waits for what
it requires, and is ready. Only one that is given `--after NAME` begins when that other one is ready. To its launcher,
the process is ready when all are. It ends when all have ended: one that ends well leaves the others alone, one that
fails takes them along. They are stopped one after the other, the last one first.
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

from ..errors import ComponentError, ConfigurationError
from ..spelling import unknown
from ..threads import NO_THREAD, start_thread
from .ending import STUCK, end_after, grace_of, settle
from .files import write_out
from .notify import CONTRACT, ENDED, notify
from .run import Running, exit_code, parser_of, prepare, tell_notes, tell_where_on_abort
from .settings import Document, Settings
from .signals import Signals
from .watchdog import Watchdog
from .worker import Worker

log = logging.getLogger("robocomp.worker")

_REMIND = 5.0
"""Seconds between two messages that say for whom a component waits."""

Part = tuple[type[Worker[Any]], Sequence[str]]
"""A component, and its arguments."""


@dataclass
class Member:
    """One of several components. Those that it is `after` begin before it does."""

    running: Running
    after: tuple[str, ...] = ()
    thread: threading.Thread = field(default_factory=threading.Thread)

    @property
    def name(self) -> str:
        return self.running.settings.instance


_LOOK_S = 0.5
"""After so long, Python looks whether there was a signal: one that comes just before a wait begins does not end it."""


class Together:
    """Components of one process, from the start of the first to the end of the last.

    `tell` takes what whoever launched the process is to know.
    """

    def __init__(self, tell: Callable[[str], None] = notify) -> None:
        self._tell = tell
        self._members: list[Member] = []
        self._changed = threading.Condition()
        self._ready: set[str] = set()
        self._ended: set[str] = set()
        self._stopping = False
        self._is_up = False
        self._news: SimpleQueue[tuple[Member, bool] | None] = SimpleQueue()
        """Who has ended, and whether well; None: somebody wants an end."""

    def add(self, worker_class: type[Worker[Any]], settings: Settings, after: Sequence[str] = ()) -> Member:
        """One more component, before `run`. Raises ComponentError if it cannot be made."""
        running = Running(worker_class, settings, tell=partial(self._told, settings.instance))
        member = Member(running, tuple(after))
        member.thread = threading.Thread(target=self._live, args=(member,), name=member.name)
        self._members.append(member)
        return member

    @property
    def every(self) -> list[Running]:
        return [member.running for member in self._members]

    def run(self) -> bool:
        """Run until the last one has ended. Whether all went well."""
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
        """Ask all to end. From any thread."""
        self._news.put(None)

    def speaking(self, record: logging.LogRecord) -> Member | None:
        """Whose message that is, asked on the thread it comes from; None if nobody can tell."""
        here = threading.current_thread()
        ways: tuple[Callable[[Member], bool], ...] = (
            lambda member: record.name == member.name,
            lambda member: member.running.speaks,  # perhaps on the thread of another one, which waits for its answer
            lambda member: member.thread is here,
        )
        return next((member for is_it in ways for member in self._members if is_it(member)), None)

    # On the thread of a component.

    def _live(self, member: Member) -> None:
        fine = False
        try:
            fine = member.running.run() if self._may_begin(member) else self._stopping
        except Exception:
            log.exception("%s failed", member.name)
        finally:
            self._news.put((member, fine))

    def _may_begin(self, member: Member) -> bool:
        """Wait for those it comes after. False if they will never be ready, or all are to end."""
        with self._changed:
            while not self._stopping:
                missing = [name for name in member.after if name not in self._ready]
                if not missing:
                    return True
                gone = [name for name in missing if name in self._ended]
                if gone:
                    log.error("%s ended before it was ready, and %s was to start after that", gone[0], member.name)
                    return False
                if not self._changed.wait(_REMIND):
                    log.info("starts after %s", ", ".join(missing))
            return False

    def _told(self, name: str, text: str) -> None:
        """What one component has to say counts when it holds for all."""
        if text.startswith(CONTRACT):
            self._tell(text)
        elif text == "READY=1":
            with self._changed:
                self._ready.add(name)
                self._changed.notify_all()
            self._tell_ready()

    def _tell_ready(self) -> None:
        """Tell that all are ready, once; until then, who is not."""
        with self._changed:
            missing = [each.name for each in self._members if each.name not in self._ready | self._ended]
            is_late, self._is_up = self._is_up or self._stopping, self._is_up or not missing
        if not is_late:
            self._tell(f"STATUS=waiting for {', '.join(missing)}" if missing else "READY=1\nSTATUS=")

    # On the thread of `run`.

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
            "Ctrl-C again ends the process now",
            file=sys.stderr,
        )


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
        "--after", action="append", default=[], metavar="NAME", help="start when that one of the same process is ready"
    )
    options = parser.parse_args(arguments)
    if options.json:
        parser.error("--json is for --print-config, which is for one component")
    if options.print_config:
        parser.error("--print-config is for one component, without a `+`")
    return options


def _prepared(parts: Sequence[Part], options: Sequence[argparse.Namespace]) -> list[tuple[Settings, Document]]:
    """The settings of all, and where they are from. Raises ConfigurationError with all that is wrong."""
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
            wrong.append(f"two components of one process are called `{settings.instance}`; give them a --name each")
        prepared[settings.instance] = settings, document
    wrong = [*(f"{', '.join(names)}: {message}" for message, names in blamed.items()), *wrong]
    if not wrong:
        after = {name: own.after for name, own in zip(prepared, options, strict=True)}
        wrong = [f"{name}: --after: {each}" for name in after for each in _never(name, after)]
    if wrong:
        raise ConfigurationError("\n".join(wrong))
    return list(prepared.values())


def _never(name: str, after: Mapping[str, Sequence[str]]) -> list[str]:
    """Why a component would never start."""
    absent = [unknown("instance", other, after) for other in after[name] if other not in after]
    if absent:
        return absent
    waits_for, new = set(after[name]), True
    while new:
        found = {other for each in waits_for for other in after.get(each, ())}
        new = not found <= waits_for
        waits_for |= found
    return [f"`{name}` waits for itself"] if name in waits_for else []


class _Speaker(logging.Filter):
    """Has messages say who speaks, and drops those that are below that one's level."""

    def __init__(self, together: Together, behind: str) -> None:
        super().__init__()
        self._together, self._behind = together, behind

    def filter(self, record: logging.LogRecord) -> bool:
        member = self._together.speaking(record)
        record.speaker = f"{member.name}{self._behind}" if member else ""
        return member is None or record.levelno >= _level(member.running.settings)


def _configure_logging(every: Sequence[Settings], together: Together) -> None:
    tell_where_on_abort()
    launched = "NOTIFY_SOCKET" in os.environ  # then whoever launched us adds the time
    form = "%(levelname)s: %(speaker)s%(message)s" if launched else "%(asctime)s %(speaker)s%(levelname)s: %(message)s"
    logging.basicConfig(level=min(map(_level, every)), format=form, datefmt="%H:%M:%S", stream=sys.stderr)
    for handler in logging.getLogger().handlers:
        handler.addFilter(_Speaker(together, ": " if launched else " "))


def _level(settings: Settings) -> int:
    return logging.getLevelNamesMapping()[settings.log.upper()]
