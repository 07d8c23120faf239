"""A network as an environment of Gymnasium."""

from __future__ import annotations

import subprocess
import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.wrappers import FlattenObservation

from robocomp_py.cli.rcgen import main as rcgen
from robocomp_py.errors import Closed, ComponentError, DeploymentError, EncodeError
from robocomp_py.gym import NetworkEnv, Range

DRIVE = "base/DifferentialRobot/setSpeedBase"
SCAN = "laser/Laser/getLaserData.ret[*].dist"
X = "base/FullPoseEstimation/getFullPoseEuler.ret.x"
Z = "base/FullPoseEstimation/getFullPoseEuler.ret.z"
FLAT = "world/DifferentialRobot/setSpeedBase"
HEARD = "world/LaserPub/pushLaserData.laserData[*].dist"
BATTERY = "world/BatteryStatus/getBatteryState.ret.state"
WHERE = "world/DifferentialRobot/getBasePose.z"

SPEEDS = {"adv": Range(-200.0, 600.0), "rot": Range(-1.0, 1.0)}


def ahead(before: dict[str, Any], action: np.ndarray[Any, Any], after: dict[str, Any]) -> float:
    """How far it came along z, in m."""
    return float(after[Z][0] - before[Z][0])


SCENE = {
    "actions": {DRIVE: SPEEDS},
    "observations": {SCAN: Range(0.0, 5000.0), X: Range(-5.0, 5.0), Z: Range(-5.0, 5.0)},
    "reward": ahead,
}
OTHER = {
    "actions": {FLAT: SPEEDS},
    "observations": {HEARD: Range(0.0, 10000.0), BATTERY: None, WHERE: None},
    "reward": lambda before, action, after: float(after[WHERE][0] - before[WHERE][0]),
}

Make = Callable[..., NetworkEnv]


@pytest.fixture
def make(networks: Path) -> Iterator[Make]:
    made: list[NetworkEnv] = []

    def make(network: str, **how: Any) -> NetworkEnv:
        made.append(NetworkEnv(networks / network, **{**(OTHER if network == "flat.ddsl" else SCENE), **how}))
        return made[-1]

    yield make
    for each in made:
        each.close()


def story(env: NetworkEnv, seed: int, steps: int = 8) -> list[Any]:
    """All that an agent is told in an episode with the same actions."""
    rng, told = np.random.default_rng(0), [env.reset(seed=seed)[0]]
    for _ in range(steps):
        observed, reward, ended, _, _ = env.step(rng.uniform(-1, 1, env.action_space.shape).astype(np.float32))
        told += [observed, reward, ended]
    return told


def same(one: list[Any], other: list[Any]) -> bool:
    return repr(one) == repr(other)


@pytest.mark.parametrize("network", ["scene.ddsl", "flat.ddsl"])
def test_the_checker_of_gymnasium_has_nothing_to_say(networks: Path, network: str) -> None:
    how = OTHER if network == "flat.ddsl" else SCENE
    name = f"Network{network.partition('.')[0].title()}-v0"
    gymnasium.register(name, entry_point=partial(NetworkEnv, networks / network, **how))  # type: ignore[arg-type]
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            env = gymnasium.make(name, max_episode_steps=5)
            check_env(env.unwrapped)
            env.reset(seed=1)
            assert [env.step(env.action_space.sample())[3] for _ in range(5)] == [False] * 4 + [True]
            env.close()
    finally:
        del gymnasium.registry[name]


@pytest.mark.parametrize("network", ["scene.ddsl", "flat.ddsl"])
def test_a_seed_repeats_and_another_one_does_not(make: Make, network: str) -> None:
    env, again = make(network), make(network)
    first = story(env, 1)
    assert same(story(again, 1), first)
    assert same(story(env, 1), first), "after another episode"
    if network != "flat.ddsl":
        assert not same(story(env, 2), first), "the noise of the base is another one"


def test_without_a_seed_each_episode_has_other_random_numbers(make: Make) -> None:
    env = make("scene.ddsl")
    env.reset(seed=1)
    positions = []
    for _ in range(2):
        env.reset()
        positions.append(env.step(np.ones(2, np.float32))[0][Z][0])
    assert positions[0] != positions[1]


def test_a_scene_alone_is_what_it_is_in_a_network(make: Make) -> None:
    assert same(story(make("scene.ddsl"), 3), story(make("both.ddsl"), 3))


def test_spaces_come_from_the_types(make: Make) -> None:
    space = make("flat.ddsl").observation_space
    assert isinstance(space, gymnasium.spaces.Dict)
    assert list(space) == [HEARD, BATTERY, WHERE]
    boxes = {name: each for name, each in space.items() if isinstance(each, gymnasium.spaces.Box)}
    assert {name: each.dtype.name for name, each in boxes.items()} == {
        HEARD: "float32",
        BATTERY: "int32",
        WHERE: "int32",
    }
    assert (boxes[HEARD].low.min(), boxes[HEARD].high.max()) == (0.0, 10000.0)
    assert (boxes[BATTERY].low.tolist(), boxes[BATTERY].high.tolist()) == ([0], [2])
    assert (boxes[WHERE].low.tolist(), boxes[WHERE].high.tolist()) == ([-(2**31)], [2**31 - 1])
    assert FlattenObservation(make("scene.ddsl")).observation_space.shape == (11,)


def test_numbers_of_an_action_stand_in_their_places(make: Make) -> None:
    goals = {"listGoals": [{"name": "pan", "position": Range(-1.0, 1.0), "maxSpeed": 0.0}]}
    env = make(
        "scene.ddsl", actions={"joints/JointMotor/setSyncPosition": goals, DRIVE: {"adv": Range(0, 100), "rot": 0.0}}
    )
    env.reset(seed=1)
    env.step(np.array([0.5, 1.0], np.float32))
    world = env.simulation["house"].worker.world
    assert world.position("pan") == pytest.approx(0.5)
    assert (world.speed("base").ahead, world.speed("base").turn) == (100.0, 0.0)
    env.step(np.array([-7.0, 7.0], np.float32))
    assert (world.position("pan"), world.speed("base").ahead) == (-1.0, 100.0)


@pytest.mark.parametrize("network", ["scene.ddsl", "both.ddsl"])
def test_an_episode_begins_where_it_is_told(make: Make, network: str) -> None:
    def begin(env: NetworkEnv) -> None:
        x, z = (1000.0 * env.np_random.uniform(-1.0, 1.0, 2)).tolist()
        pose = {"x": x, "y": 0.0, "z": z, "rx": 0.0, "ry": 0.0, "rz": 0.0}
        env.call("house/InnerModelManager/setPoseFromParent", item="base", pose=pose)

    env = make(network, begin=begin)
    starts = [env.reset(seed=seed)[0][X][0] for seed in (1, 2, 1)]
    assert starts[0] == starts[2] != starts[1]
    assert -1.0 < starts[0] < 1.0


def test_edits_of_an_episode_are_gone_in_the_next_one(make: Make) -> None:
    env = make("scene.ddsl")
    before = story(env, 1)
    env.call("house/InnerModelManager/removeNode", item="mount")
    with pytest.raises(Exception, match="laser"):
        env.step(np.zeros(2, np.float32))
    assert same(story(env, 1), before)


def test_an_episode_ends_as_its_function_says(make: Make) -> None:
    env = make("scene.ddsl", ended=lambda observed: observed[Z][0] > 0.05)
    env.reset(seed=1)
    ended = [env.step(np.array([1.0, 0.0], np.float32))[2] for _ in range(2)]
    assert ended == [False, True]
    with pytest.raises(ValueError, match="call `reset`"):
        env.step(np.zeros(2, np.float32))


def test_the_reward_is_of_a_step(make: Make) -> None:
    env = make("scene.ddsl")
    start, _ = env.reset(seed=1)
    after, reward, *_ = env.step(np.array([1.0, 0.0], np.float32))
    assert reward == pytest.approx(after[Z][0] - start[Z][0])
    assert reward > 0.01


def test_an_agent_may_change_what_it_is_told(make: Make) -> None:
    env = make("scene.ddsl")
    observed, _ = env.reset(seed=1)
    observed[Z][0] = 100.0
    assert env.step(np.zeros(2, np.float32))[1] == pytest.approx(0.0, abs=1.0)


@pytest.mark.parametrize("network", ["scene.ddsl", "both.ddsl"])
def test_closing_leaves_nothing(make: Make, network: str) -> None:
    before = set(threading.enumerate())
    env = make(network)
    env.reset(seed=1)
    env.close()
    env.close()
    assert {each for each in threading.enumerate() if each.name.startswith("simulation")} <= before
    with pytest.raises(Closed, match="reset"):
        _ = env.simulation


def test_several_run_in_one_process(networks: Path) -> None:
    both = gymnasium.vector.SyncVectorEnv([partial(NetworkEnv, networks / "scene.ddsl", **SCENE)] * 2)  # type: ignore[arg-type]
    try:
        both.reset(seed=[1, 1])
        observed, *_ = both.step(np.zeros((2, 2), np.float32))
        assert observed[SCAN].shape == (2, 9)
        assert (observed[SCAN][0] == observed[SCAN][1]).all()
    finally:
        both.close()


@pytest.mark.parametrize(
    ("how", "says"),
    [
        ({"actions": {"base/DifferentialRobot/setSpeedBass": SPEEDS}}, "did you mean `base/DifferentialRobot/setSp"),
        ({"actions": {DRIVE: {"adv": 0.0, "rot": 0.0}}}, "write a Range"),
        ({"actions": {"laser/LaserPub/pushLaserData": {"laserData": []}}}, "is a topic"),
        ({"observations": {}}, "there are none"),
        ({"observations": {"laser/Laser/getLaserDate.ret[*].dist": None}}, "did you mean `laser/Laser/getLaserData`"),
        (
            {"observations": {"laser/Laser/getLaserData": None}},
            "name a number in its message, such as .*getLaserData.ret",
        ),
        ({"observations": {"joints/JointMotor/getMotorState.ret.pos": Range(0, 1)}}, "needs motor"),
        ({"observations": {"base/DifferentialRobot/stopBase.x": None}}, "has no result"),
        ({"observations": [SCAN]}, "observations: it must be a dictionary"),
        ({"observations": {SCAN: (0, 6000)}}, "give it a Range, or None"),
        ({"actions": {DRIVE: Range(0, 1)}}, "its inputs are a dictionary"),
        ({"actions": {DRIVE: {"adv": Range(0, 1), "rot": "x"}}}, "setSpeedBase: rot must be a float"),
        ({"seconds": 0.0}, "more than 0"),
        ({"seconds": 0.012}, "multiple of the tick"),
    ],
)
def test_what_the_network_has_not_is_told_before_anything_is_learnt(make: Make, how: dict[str, Any], says: str) -> None:
    with pytest.raises((ValueError, KeyError, TypeError), match=says):
        make("scene.ddsl", **how)


PILOT = """\
module RoboCompPilot
{
    interface Pilot
    {
        [action] int fly(int height) feedback(int left);
        void hover(int height);
    };
};
"""
DRONE = """\
import "Pilot.idsl";
Component drone { Communications { implements Pilot; }; language python; };
"""


def test_an_action_is_told_to_be_one_and_is_proposed_for_a_misspelt_one(tmp_path: Path) -> None:
    (tmp_path / "Pilot.idsl").write_text(PILOT)
    (tmp_path / "drone.cdsl").write_text(DRONE)
    (tmp_path / "sky.ddsl").write_text('import "drone/drone.cdsl";\nDeployment sky { Component drone { }; };\n')
    assert rcgen([str(tmp_path / "drone.cdsl"), "-o", str(tmp_path / "drone")]) == 0
    (tmp_path / "drone.cdsl").rename(tmp_path / "drone" / "drone.cdsl")
    (tmp_path / "Pilot.idsl").rename(tmp_path / "drone" / "Pilot.idsl")

    def fly(name: str) -> None:
        how: dict[str, Any] = {"observations": {}, "reward": ahead}
        NetworkEnv(tmp_path / "sky.ddsl", actions={name: {"height": Range(0, 9)}}, **how)

    with pytest.raises(ValueError, match="drone/Pilot/fly is an action, whose goals last for many steps"):
        fly("drone/Pilot/fly")
    with pytest.raises(KeyError, match="did you mean `drone/Pilot/fly`"):
        fly("drone/Pilot/flyy")


@pytest.mark.parametrize(("low", "high"), [(1.0, 1.0), (2.0, 1.0), (0.0, float("inf")), (float("nan"), 1.0)])
def test_a_range_has_two_numbers(low: float, high: float) -> None:
    with pytest.raises(ValueError, match="finite numbers, the lower one first"):
        Range(low, high)


def test_a_wrong_action_is_refused(make: Make) -> None:
    env = make("scene.ddsl")
    env.reset(seed=1)
    for wrong in (np.zeros(3), np.array([np.nan, 0.0]), 0.0):
        with pytest.raises(ValueError, match="2 finite numbers"):
            env.step(wrong)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="no options"):
        env.reset(options={"quick": True})
    with pytest.raises(TypeError, match="adv, rot"):
        env.call(DRIVE, adv=1.0)
    with pytest.raises(EncodeError, match="rot must be a float"):
        env.call(DRIVE, adv=1.0, rot="left")


def test_a_reward_that_is_no_number_is_refused(make: Make) -> None:
    env = make("scene.ddsl", reward=lambda before, action, after: None)
    env.reset(seed=1)
    with pytest.raises(TypeError, match="reward: it returned None, which is not a number"):
        env.step(np.zeros(2, np.float32))


def test_a_network_that_cannot_be_simulated_is_told(make: Make, networks: Path) -> None:
    (networks / "wrong.ddsl").write_text("Deployment wrong { Component house { }; };\n")
    with pytest.raises(DeploymentError, match="house"):
        make("wrong.ddsl")
    (networks / "lost.ddsl").write_text((networks / "scene.ddsl").read_text())
    with pytest.raises(ComponentError, match="house failed"):
        make("lost.ddsl", settings=[("house", 'params.scene="nowhere.xml"')])


def test_without_gymnasium_the_extra_is_named() -> None:
    code = "import sys; sys.modules['gymnasium'] = None; import robocomp_py.gym"
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False).stderr
    assert "pip install 'robocomp-py[gym]'" in said
