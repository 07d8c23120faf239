"""Two arms hand over a bottle, back and forth.

One takes it from above and holds it between both. The other one takes it from the side,
and puts it down on its half of the table, from where it takes it from above.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from robocomp_py.errors import TransportError
from robocomp_py.innermodel import axes

from .generic.genericworker import GenericWorker
from .generic.RoboCompArm import ArmProxy, Pose
from .generic.RoboCompInnerModelManager import Pose3D

HIGH, WIDE = 100, 30
"""mm: half of the height and of the width of the bottle."""
GAP = 4
"""mm, between a cup and the bottle when it takes it."""
AWAY = 100
"""mm, from where a cup moves straight to the bottle."""


@dataclass(frozen=True)
class Hand:
    """An arm with a suction cup."""

    arm: ArmProxy
    cup: str
    side: int
    """-1 for the left one, 1 for the right one: its side of the table along x."""

    @property
    def facing(self) -> float:
        """How far it is turned, rad."""
        return -self.side * math.pi / 2


class SpecificWorker(GenericWorker):
    def initialize(self) -> None:
        """Put the bottle anywhere on the left half."""
        self.left = Hand(self.arm_proxy, "leftcup", -1)
        self.right = Hand(self.arm1_proxy, "rightcup", 1)
        x, z, turn = self.anywhere(self.left), self.beside(), self.random.uniform(-3, 3)
        self.innermodelmanager_proxy.setPoseFromParent(
            "bottle", Pose3D(x, HIGH, z, 0.0, turn, 0.0)
        )
        self.job = self.hand_over()

    def compute(self) -> None:
        """Go on until the generator waits again."""
        try:
            is_over = next(self.job, self) is self
        except TransportError as exc:  # a generator that has raised cannot go on
            raise RuntimeError(f"the cell does not answer: {exc}") from exc
        if is_over:
            self.log.info("that was the last time")
            self.stop()

    def hand_over(self) -> Iterator[None]:
        """All that is to be done. It yields when it has to wait."""
        giver, taker = self.left, self.right
        for number in range(self.params.times):
            yield from self.pick(giver)
            yield from self.meet(giver)
            yield from self.take(taker, giver)
            yield from self.put(taker)
            self.log.info("%s has it, %d", taker.cup, number + 1)
            giver, taker = taker, giver

    def pick(self, hand: Hand) -> Iterator[None]:
        """Take the bottle from above, turned like it."""
        at = self.where()
        turn = hand.facing + math.remainder(at.ry - hand.facing, math.pi / 2)
        above = at.y + HIGH + GAP
        yield from self.go(hand, at.x, above + AWAY, at.z, turn)
        yield from self.go(hand, at.x, above, at.z, turn)
        self.grip(hand)
        yield from self.go(hand, at.x, above + AWAY, at.z, turn)

    def meet(self, hand: Hand) -> Iterator[None]:
        """Hold it anywhere between both arms, with a side to each of them."""
        x, y = self.random.uniform(-40, 40), self.random.uniform(430, 500)
        yield from self.go(hand, x, y, self.random.uniform(-100, 100), hand.facing)

    def take(self, hand: Hand, giver: Hand) -> Iterator[None]:
        """Take it from the side. The giver lets it go, and leaves upwards."""
        at, to = self.where(), hand.side * (WIDE + GAP)
        yield from self.reach(hand, hand.side * 170, 520, 0)  # without a turn aside
        yield from self.reach(hand, at.x + to + hand.side * AWAY, at.y, at.z)
        yield from self.reach(hand, at.x + to, at.y, at.z)
        self.grip(hand)
        self.simulation_proxy.detach(giver.cup)
        yield from self.go(giver, at.x, at.y + HIGH + AWAY, at.z, giver.facing)
        yield from self.rest(giver)

    def put(self, hand: Hand) -> Iterator[None]:
        """Put it down anywhere on the own half of the table."""
        x, z = self.anywhere(hand) + hand.side * (WIDE + GAP), self.beside()
        yield from self.reach(hand, x, HIGH + AWAY, z)
        yield from self.reach(hand, x, HIGH + GAP, z)
        self.simulation_proxy.detach(hand.cup)
        away = x + hand.side * AWAY
        yield from self.reach(hand, away, HIGH + GAP, z)
        yield from self.reach(hand, away, 3 * HIGH, z)
        yield from self.rest(hand)

    def rest(self, hand: Hand) -> Iterator[None]:
        """Out of the way of the other arm."""
        hand.arm.rest()
        yield from self.wait(hand)

    def go(
        self, hand: Hand, x: float, y: float, z: float, turn: float
    ) -> Iterator[None]:
        """Until the tool is at a place, and points down."""
        yield from self.move(hand, Pose(x, y, z, 0.0, turn, 0.0))

    def reach(self, hand: Hand, x: float, y: float, z: float) -> Iterator[None]:
        """Until the tool is at a place, and points to the other arm."""
        tilt = axes.about("z", hand.facing) @ axes.about("y", hand.facing)
        yield from self.move(hand, Pose(x, y, z, *axes.angles(tilt).tolist()))

    def move(self, hand: Hand, goal: Pose) -> Iterator[None]:
        hand.arm.move(goal, 0.0)
        yield from self.wait(hand)

    def wait(self, hand: Hand) -> Iterator[None]:
        """Until an arm is where it was told to go."""
        while not hand.arm.isThere():
            yield

    def grip(self, hand: Hand) -> None:
        if self.simulation_proxy.attach(hand.cup) != "bottle":
            raise RuntimeError(f"{hand.cup} does not reach the bottle")

    def anywhere(self, hand: Hand) -> float:
        """A place along x on the half of an arm, mm."""
        return hand.side * self.random.uniform(60, 150)

    def beside(self) -> float:
        """A place along z that is not between the arms, mm."""
        side: int = self.random.choice((-1, 1))
        return side * self.random.uniform(120, 280)

    def where(self) -> Pose3D:
        """What a camera would tell."""
        _, found = self.innermodelmanager_proxy.getPose("root", "bottle")
        return found
