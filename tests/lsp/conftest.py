"""A small project, and an editor on it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from .editor import Editor

FILES = {
    "Joints.idsl": """\
module RoboCompJoints
{
    // Where a joint is.
    struct Joint
    {
        string name;
        float angle; // rad
    };
    sequence<Joint> Joints;
    enum Mode { held, free };

    exception Blocked
    {
        string what;
    };
};
""",
    "Arm.idsl": """\
import "Joints.idsl";

module RoboCompArm
{
    // Moves an arm.
    interface Arm
    {
        // Where all joints are.
        RoboCompJoints::Joints getJoints();
        void moveTo(RoboCompJoints::Joint goal, float speed) throws RoboCompJoints::Blocked;
    };
};
""",
    "arm/arm.cdsl": """\
import "../Arm.idsl";

// The arm itself.
Component arm
{
    Communications
    {
        implements Arm;
    };
    language python;
    params "arm.pdsl";
    statemachine "arm.smdsl";
};
""",
    "arm/arm.pdsl": """\
ComponentParams arm
{
    speed "rad/s" float 0.5 0:2;
    grip enum soft { soft, hard };
};
""",
    "arm/arm.smdsl": """\
arm
{
    states moving;
    initial_state resting;
    end_state parked;
    transitions
    {
        resting => moving, parked;
        moving => resting;
    };
};
""",
    "arm/specificworker.py": """\
class SpecificWorker:
    def Arm_getJoints(self):
        return []

    def Arm_moveTo(self, goal, speed):
        self.limit = self.params.speed

    def sm_moving(self):
        self.t_moving_to_resting()
""",
    "arm/etc/config.toml": """\
[params]
speed = 0.7
""",
    "chess/chess.cdsl": """\
import "../Arm.idsl";

Component chess
{
    Communications
    {
        requires Arm;
    };
    language python;
};
""",
    "chess/specificworker.py": """\
class SpecificWorker:
    def compute(self):
        self.arm_proxy.moveTo(None, 1.0)
""",
    "game.ddsl": """\
import "arm/arm.cdsl";
import "chess/chess.cdsl";

Deployment game
{
    Component left : arm {};
    Component chess
    {
        dependences left;
        requires Arm from left;
    };
};
""",
}

FLEET = """\
import "arm/arm.cdsl";
import "chess/chess.cdsl";

Deployment fleet
{
    host onboard { address "192.168.1.10"; };
    Component spare : arm { host onboard; restart always(period 10); existing "spare"; notifies; };
    System north
    {
        host onboard;
        escalation one_for_one;
        Component hand : arm {};
        System inner { Component chess { dependences hand; requires Arm from hand; }; };
    };
    System south { Component hand : arm {}; Component chess { dependences north/hand, hand; }; };
};
"""
"""A network on several hosts, with systems. It is no file of the project: who needs it opens it."""


def write_project(folder: Path) -> Path:
    for name, text in FILES.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    return folder


@pytest.fixture(scope="session")
def session(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Editor]:
    """One session for most tests, since a server takes a while to start."""
    opened = Editor(tmp_path_factory.mktemp("nothing"))
    yield opened
    assert opened.leave() == 0
    assert opened.complaints == ""


@pytest.fixture
def editor(session: Editor, tmp_path: Path) -> Iterator[Editor]:
    """On a project of the test's own. Whatever the test does, the server makes no mistake."""
    session.move_to(write_project(tmp_path))
    yield session
    assert session.mistakes == []


@pytest.fixture(scope="module")
def reader(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Editor]:
    """One that all tests of a module share, with everything open: they change nothing."""
    opened = Editor(write_project(tmp_path_factory.mktemp("project")))
    for name in FILES:
        if not name.endswith((".py", ".toml")):
            opened.open(name)
    yield opened
    assert opened.leave() == 0
    assert opened.mistakes == []
