"""Takes parts from a conveyor: each arm every other one, which it puts on its bench.

What an arm does is a generator. It yields when it has to wait, and `compute` goes on.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from robocomp_py.errors import TransportError

from .generic.genericworker import GenericWorker
from .generic.RoboCompArm import ArmProxy, Pose
from .generic.RoboCompInnerModelManager import Pose3D

HALF = 30
"""mm: half of the height of a part."""
GAP = 4
"""mm, between a cup and the part that it takes, or a part and the bench."""
HIGH = 200
"""mm, at which the parts are carried."""
REACH = 300
"""mm along the belt, from the foot of an arm."""


@dataclass(frozen=True)
class Hand:
    """An arm with a suction cup."""

    arm: ArmProxy
    cup: str
    x: float
    """mm, of its foot."""
    z: float
    facing: float
    """rad: how far it is turned."""


class SpecificWorker(GenericWorker):
    def initialize(self) -> None:
        """Lay the parts on the belt, anyhow."""
        left = Hand(self.arm_proxy, "leftcup", -600, -300, math.pi / 2)
        right = Hand(self.arm1_proxy, "rightcup", 600, 700, -math.pi / 2)
        names = [f"part{number + 1}" for number in range(self.params.parts)]
        z = -500.0
        for name in names:
            x, turn = self.random.uniform(-80, 80), self.random.uniform(-3.1, 3.1)
            self.innermodelmanager_proxy.setPoseFromParent(
                name, Pose3D(x, HALF, z, 0.0, turn, 0.0)
            )
            z -= self.random.uniform(350, 450)
        self.jobs = [self.sort(left, names[::2]), self.sort(right, names[1::2])]

    def compute(self) -> None:
        """Go on with what the arms do."""
        try:
            self.jobs = [job for job in self.jobs if next(job, self) is None]
        except TransportError as exc:  # a generator that has raised cannot go on
            raise RuntimeError(f"the cell does not answer: {exc}") from exc
        if not self.jobs:
            self.log.info("all parts are sorted")
            self.stop()

    def sort(self, hand: Hand, parts: list[str]) -> Iterator[None]:
        """Take the parts one after the other, and put them in a row."""
        for number, part in enumerate(parts):
            while self.where(part).z < hand.z - REACH:
                yield
            yield from self.take(hand, part)
            at = self.where(part)
            yield from self.go(hand, at.x, HIGH, at.z)
            x, z = hand.x + 100 * (number - 1), hand.z + 450
            yield from self.go(hand, x, HIGH, z)
            yield from self.go(hand, x, 2 * HALF + 2 * GAP, z)
            self.simulation_proxy.detach(hand.cup)
            self.log.info("%s is on the bench of %s", part, hand.cup)
            yield from self.go(hand, x, HIGH, z)

    def take(self, hand: Hand, part: str) -> Iterator[None]:
        """Follow a part from above, then touch it."""
        yield from self.follow(hand, part, HALF + 100)
        while self.simulation_proxy.attach(hand.cup) != part:
            yield from self.follow(hand, part, HALF + GAP)

    def follow(self, hand: Hand, part: str, height: float) -> Iterator[None]:
        """Until the tool is so far above the middle of a part, and turned like it."""
        while True:
            at = self.where(part)
            if at.z > hand.z + REACH:
                raise RuntimeError(f"{part} has passed {hand.cup}")
            turn = hand.facing + math.remainder(at.ry - hand.facing, math.pi / 2)
            goal = Pose(at.x, at.y + height, at.z, 0.0, turn, 0.0)
            hand.arm.move(goal, self.params.belt)
            yield
            if hand.arm.isThere():
                return

    def go(self, hand: Hand, x: float, y: float, z: float) -> Iterator[None]:
        """Until the tool is at a place, and points down."""
        hand.arm.move(Pose(x, y, z, 0.0, hand.facing, 0.0), 0.0)
        while not hand.arm.isThere():
            yield

    def where(self, part: str) -> Pose3D:
        """What a camera above the belt would tell."""
        _, found = self.innermodelmanager_proxy.getPose("root", part)
        return found
