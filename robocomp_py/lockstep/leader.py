"""Moves the clocks of a network from one instant to the next, once all its components are done with the present one."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Generator, Mapping, Sequence
from typing import TYPE_CHECKING, TypeAlias, TypeVar

from ..contract.component import Port
from ..contract.interface import Verb
from ..errors import Closed, ComponentError, RobocompError, Timeout
from ..runtime.clock import NEVER
from ..threads import NO_THREAD
from ..wire import names
from .balance import Balance, State
from .cores import ANY_CORE, present_core
from .handover import Handover
from .links import LocalComponent, Reaches
from .membership import Membership
from .pace import Pace
from .participants import UNKNOWN, LocalLink, Participant, link_to
from .pollable import PollableEvent
from .RoboCompClock import CLOCKCONTROL_INTERFACE, ClockState
from .RoboCompLockstep import (
    LOCKSTEPFOLLOWER_INTERFACE,
    LOCKSTEPLEADER_INTERFACE,
    LockstepFollowerProxy,
)

if TYPE_CHECKING:
    from ..runtime.settings import Settings

log = logging.getLogger("robocomp.clock")

_T = TypeVar("_T")

Course: TypeAlias = Generator[bool, None, _T]

_SILENT = 3
"""Number of questions in a row that a follower may leave unanswered."""

_CHANGES = 10_000
"""More changes of its counters than this at once are those of a restarted component, whose versions begin at random."""

_LOST = 0.25
"""Seconds after which a message that has not arrived counts as lost, if nothing moves."""

_TELL = 5.0
"""Seconds after which the log names the components for which the clock waits."""

_IDLE = 0.05
"""Seconds between two looks at components that have nothing to do at any time."""

_LOOKS = 3
"""How often calls make the leader look at all components before the clock goes on: some may never stop calling."""

_MOVES = 1000
"""Instants after which the leader checks on which core its loop runs: the system may have moved it."""


class Leader:
    """The leader of a clock. `open`, `begin` when its component is about to be ready, `close`.

    It asks one component at a time: its own, then the others in the order of the network. It goes on to the next
    instant when all threads of all components wait, and all that they sent was handled.

    Its course is a generator, so that the loop of its component may lead while it waits: it yields where another thread
    may go on with it, and yields True if that loop is due.
    """

    def __init__(self, settings: Settings, member: LocalComponent, fail: Callable[[str], None]) -> None:
        """`fail` ends the component: because a follower was lost, if its configuration says so."""
        assert settings.clock
        self._clock, self._patience = settings.clock, settings.startup_timeout
        self._member, self._fail = member, fail
        followers = [names.whole(name, settings.namespace) for name in self._clock.followers]
        self.membership = Membership(member.instance, followers)
        """Answers what followers ask."""
        self._pace = Pace(self._clock.speed)
        self._now = 0
        self._are_quick = False
        """Whether questions to all of them take so little time that the loop may ask."""
        self._balance = Balance({})
        self._receivers: set[str] = set()
        """The components to which others send something."""
        self._is_outdated = False
        """Whether a call was made whose handler may have sent something that is not known yet."""
        self._is_level = True
        """Whether nothing was under way when the components were last looked at."""
        self._connections: Reaches | None = None
        self._closing = threading.Event()
        self._lost_on: set[str] = set()
        """The channels of lost messages that were reported."""
        self._course = self._lead()
        self._asking: PollableEvent | None = None
        """The event of the loop, while the loop leads."""
        self.is_for_loop = False
        """Whether nothing takes long now: there is no pause, and no component joins or leaves."""
        self._core, self._instants = ANY_CORE, 0
        self.handover = Handover(f"{member.instance[1:]}-leader", self)

    def open(self, connections: Reaches) -> None:
        self._connections = connections
        connections.serve(Port(Verb.IMPLEMENTS, LOCKSTEPLEADER_INTERFACE), self.membership)
        connections.serve(Port(Verb.IMPLEMENTS, CLOCKCONTROL_INTERFACE), self)

    def begin(self) -> None:
        """Start to move the clocks, once all followers are there."""
        if not self.handover.begin():
            raise ComponentError(f"the clock cannot be led: {NO_THREAD}")

    def close(self) -> None:
        self._closing.set()
        self._pace.close()
        self.membership.news.set()
        self.handover.close()
        self.membership.hang_up()

    # What tools ask that drive the clock.

    def ClockControl_state(self) -> ClockState:
        stand = self._pace.stand
        followers = [name[1:] for name in self.membership.followers]
        return ClockState(self._now, stand.speed, stand.paused, followers)

    def ClockControl_pause(self) -> None:
        self._pace.pause()

    def ClockControl_resume(self) -> None:
        self._pace.resume()

    def ClockControl_step(self, seconds: float) -> int:
        return self._pace.step(seconds)

    def ClockControl_setSpeed(self, speed: float) -> None:
        self._pace.set_speed(speed)

    # The task, for `handover`.

    def core(self) -> int:
        """The core on which its loop runs. Called on the thread of the loop."""
        self._instants -= 1
        if self._instants < 0:
            self._instants = _MOVES
            self._wait_on(present_core())
        return self._core

    def _wait_on(self, core: int) -> None:
        self._core = core
        for each in self._participants:
            if each.line:
                each.line.core = core

    def serve(self, wake: PollableEvent, timeout: float, *, is_loop: bool) -> bool:
        self._asking = wake if is_loop else None
        if not is_loop:
            self._instants = 0
            self._wait_on(ANY_CORE)
        for is_due in self._course:
            if is_due:
                return True
            if wake.is_set() or (is_loop and not self.is_for_loop):
                return wake.is_set()
        return wake.wait(timeout)  # the clock stands still for ever

    # The clock.

    @property
    def _participants(self) -> Sequence[Participant]:
        return self.membership.participants

    def _lead(self) -> Course[None]:
        try:
            self._gather()
            self._now = self.membership.latest(self._now)  # from which the clock goes on
            self.membership.replace([Participant(self._member.instance, LocalLink(self._member))])
            yield from self._admit()
            self._pace.begin(self._now)
            while not self._closing.is_set():
                yield from self._go_on()
        except Closed:
            return
        except Exception as exc:  # the component must not live on with a clock that stands still
            log.exception("the clock stopped")
            self._fail(f"the clock stopped: {exc}")
        finally:
            self.is_for_loop = False

    def _go_on(self) -> Course[None]:
        """To the next instant, if it is time."""
        due = max(self._now, min(each.state.due for each in self._participants))
        has_requests = self.membership.has_requests
        self.is_for_loop = not has_requests and due != NEVER and self._pace.is_unbound and self._are_quick
        yield False
        while self._asking and not self.is_for_loop:
            yield False  # what follows may take long
        if has_requests:
            yield from self._admit()
            return
        instant = self._pace.wait(due)
        if instant is not None:
            yield from self._tick(instant)
        elif not self._closing.is_set():
            yield from self._look(self._participants, UNKNOWN)
            self._is_level = False

    def _gather(self) -> None:
        """Wait for the followers that the network names."""
        begun, told = time.monotonic(), 0.0
        while not self._closing.is_set():
            absent = self.membership.absent
            waited = time.monotonic() - begun
            if not absent:
                return
            listed = ", ".join(name[1:] for name in absent)
            if waited > self._patience:
                log.warning("the clock starts without %s, for which it has waited %g s", listed, self._patience)
                return
            if waited - told > _TELL:
                told = waited
                log.info("the clock waits for %s", listed)
            self.membership.news.wait(_IDLE)
            self.membership.news.clear()

    def _admit(self) -> Course[None]:
        """Let those take part that want to join, and no longer those that left."""
        joining, participants = self.membership.take_changes()
        assert self._connections
        port = Port(Verb.REQUIRES, LOCKSTEPFOLLOWER_INTERFACE, proxy=LockstepFollowerProxy)
        for name, now in joining.items():
            self._now = max(self._now, now)
            proxy, close = self._connections.reach(port, name)
            participants.append(Participant(name, link_to(proxy), close))
        yield from self._start_together(participants)

    def _start_together(self, participants: Sequence[Participant]) -> Course[None]:
        """Go on with these components, all at the present instant."""
        self.membership.replace(participants)
        self._are_quick, self._instants = all(each.is_quick for each in self._participants), 0
        for each in self._participants:  # so that handlers see the time; and what was sent until now is not under way
            yield from self._ask(each, each.link.tell, self._now)
        self._count_anew()
        for each in self._participants:
            yield from self._ask(each, each.link.step, self._now)
            yield from self._settle()

    def _tick(self, instant: int) -> Course[None]:
        self._now = instant
        participants = self._participants
        if not self._is_level:
            self._is_level = True
            yield from self._settle()
        is_first = True
        for each in participants:  # so that handlers see the time
            if each.state.due > instant:
                yield from self._ask(each, each.link.step, instant)
            elif not is_first and each.name in self._receivers:
                yield from self._ask(each, each.link.tell, instant)
            else:
                is_first = False
        for each in participants:
            if each.state.due <= instant and each in self._participants:
                before = each.state
                yield from self._ask(each, each.link.step, instant)
                if self._is_outdated or not each.state.settled or each.state[2:] != before[2:]:
                    yield from self._settle()  # otherwise, nothing was sent and nothing was handled

    def _settle(self) -> Course[None]:
        """Wait until all threads wait, and all that was sent was handled."""
        begun = moved = time.monotonic()
        told, looks = False, 0
        while not self._closing.is_set():
            if any(each.state.version != each.version for each in self._participants):
                same = {each.name for each in self._participants if 0 <= each.state.version - each.version < _CHANGES}
                before = self._balance
                self._count_anew()
                self._balance.take_over(before, {name: each for name, each in self._numbers().items() if name in same})
            numbers = self._numbers()
            flows = self._balance.under_way(numbers)
            concerned = {name for flow in flows for name, _ in flow.concerned}
            busy = [each for each in self._participants if not each.state.settled or each.name in concerned]
            if not busy:
                if self._is_outdated and looks < _LOOKS:
                    looks, self._is_outdated = looks + 1, False
                    yield from self._look(self._participants, UNKNOWN)
                    continue
                self._is_outdated = False
                ahead = {name for flow in self._balance.ahead(numbers) for name, _ in flow.senders}
                senders = [each for each in self._participants if each.name in ahead]
                if senders and (yield from self._look(senders, UNKNOWN)):
                    continue  # they had sent more since they were asked
                self._balance.level(numbers)
                return
            yield False  # the loop may have to go on first
            now = time.monotonic()  # before it looks: this process may have been stopped for a while
            if (yield from self._look(busy)):
                moved = time.monotonic()
                continue
            if now - moved > _LOST and all(each.state.settled for each in busy):
                for flow in flows:
                    if not flow.is_of_calls:
                        self._tell_lost(flow.channel, flow.under_way(numbers))
                        flow.level(numbers)
            if not told and now - begun > _TELL:
                told = True
                log.warning("the clock stands still: it waits for %s", ", ".join(each.name[1:] for each in busy))

    def _look(self, participants: Sequence[Participant], last: State | None = None) -> Course[bool]:
        """Ask for states that differ from `last`, by default the known ones; returns whether anything has changed."""
        changed = False
        for each in participants:
            before = each.state
            yield from self._ask(each, each.link.look, last or before)
            changed |= each.state != before or each not in self._participants
        return changed

    def _ask(self, participant: Participant, question: Callable[[_T], None], about: _T) -> Course[None]:
        """Take a new report of a component; without an answer, go on without it."""
        made = participant.state.made
        try:
            question(about)
            while (state := participant.link.answer(self._asking)) is None:
                yield participant.is_local
            participant.state, participant.silent = state, 0
            self._is_outdated |= state.made != made
        except Timeout as exc:
            participant.silent += 1
            if participant.silent >= _SILENT:
                self._drop(participant, f"does not answer ({exc})")
        except RobocompError as exc:
            self._drop(participant, f"is gone ({exc})")

    def _count_anew(self) -> None:
        """Take the counters that the components have now. No message counts as under way."""
        for participant in self._participants:
            if participant.state.version != participant.version:
                try:
                    participant.counters, participant.version = participant.link.counters(), participant.state.version
                except RobocompError as exc:
                    self._drop(participant, f"is gone ({exc})")
        self._balance = Balance({each.name: each.counters for each in self._participants})
        self._balance.level(self._numbers(), all=True)
        self._receivers = self._balance.receivers

    def _drop(self, participant: Participant, why: str) -> None:
        has_left = self.membership.drop(participant)
        self._count_anew()
        if self._closing.is_set() or has_left:
            return
        if self._clock.lost == "stop":
            self._closing.set()
            self._fail(f"{participant.name[1:]}, which follows this clock, {why}")
        else:
            log.warning("%s, which follows this clock, %s; the clock goes on without it", participant.name[1:], why)

    def _numbers(self) -> Mapping[str, Sequence[int]]:
        return {each.name: each.state.numbers for each in self._participants}

    def _tell_lost(self, channel: str, number: int) -> None:
        if channel not in self._lost_on:
            self._lost_on.add(channel)
            what = "a message" if number == 1 else f"{number} messages"
            log.warning("%s of %s got lost; later losses of it are not reported", what, channel)
