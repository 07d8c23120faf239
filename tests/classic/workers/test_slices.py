"""Types are as slice2py makes them, and Ice's exceptions as Ice has them."""

from __future__ import annotations

import copy
import importlib
import inspect
import pickle
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from robocomp_py import errors
from robocomp_py.classic.workers.ice import Ices, real, uses_ice
from robocomp_py.cli.rcgen import main as rcgen
from robocomp_py.testing.components import ComponentTest, load_component

from .components import OF_2021, made


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, ModuleType]]:
    """The modules that a component is given."""
    folder = made(tmp_path_factory.mktemp("slices") / "slices", OF_2021)
    with ComponentTest(load_component(folder), {"params.InnerModelPath": "x"}) as test:
        yield test.worker._imports.given


@pytest.fixture
def arm(given: dict[str, ModuleType]) -> Any:
    return given["RoboCompArm"]


def test_structs_hold_zeros_and_nothing_where_slice2py_has_nothing(arm: Any) -> None:
    joint = arm.Joint()
    assert (joint.name, joint.angle, joint.on, joint._lambda) == ("", 0.0, False, 0)
    assert (joint.picture, joint.past) == (None, None)
    assert joint.mode is arm.Mode.idle


def test_structs_take_positions_and_names_and_any_attribute(arm: Any) -> None:
    joint = arm.Joint("a", 1.5, on=True)
    assert (joint.name, joint.angle, joint.on) == ("a", 1.5, True)
    joint.note = "mine"
    assert copy.deepcopy(joint) == joint == arm.Joint("a", 1.5, on=True)
    assert pickle.loads(pickle.dumps(joint)).note == "mine"
    assert joint != arm.Joint("b", 1.5, on=True)


def test_enumerators_have_names_values_and_texts(arm: Any) -> None:
    assert (arm.Mode.moving.name, arm.Mode.moving.value, str(arm.Mode.moving)) == ("moving", 1, "moving")
    assert arm.Mode.valueOf(1) is arm.Mode.moving
    assert arm.Mode.valueOf(7) is None
    assert str(arm.Mode._print) == "print"


def test_sequences_have_classes_of_lists(given: dict[str, Any], arm: Any) -> None:
    joints = arm.Joints([arm.Joint()])
    joints.append(arm.Joint())
    joints.extend([])
    joints.insert(0, arm.Joint())
    assert isinstance(joints, list)
    assert len(joints) == 3
    assert given["interfaces"].Joints is arm.Joints
    assert arm.Paths(left=[1]) == {"left": [1]}


def test_modules_are_reached_through_those_that_import_them(given: dict[str, Any], arm: Any) -> None:
    assert given["interfaces"].RoboCompArm.RoboCompFrame.Frame is given["RoboCompFrame"].Frame
    assert given["genericworker"].RoboCompFrame is given["RoboCompFrame"]
    assert given["interfaces"].console.print
    with pytest.raises(AttributeError, match="`RoboCompHand` is none of the component's interfaces; those are"):
        _ = given["interfaces"].RoboCompHand
    assert arm.ArmPrx.checkedCast("proxy") == "proxy"


def test_declared_exceptions_are_ice_s(given: dict[str, Any], arm: Any) -> None:
    stuck = arm.Stuck("no way")
    assert (stuck.what, stuck.joint) == ("no way", 1)
    assert isinstance(stuck, given["Ice"].UserException | errors.DeclaredError)
    assert "no way" in str(stuck)


class _Base(Exception):
    """As Ice's own, which says what its fields are."""

    def __str__(self) -> str:
        raise AssertionError("this is no exception of Ice's")


def _zeroc() -> dict[str, ModuleType]:
    """Something like the module of ZeroC."""
    module, storm = ModuleType("Ice"), ModuleType("IceStorm")
    module.Exception = _Base  # type: ignore[attr-defined]
    for name, base in (("LocalException", "Exception"), ("UserException", "Exception")):
        setattr(module, name, type(name, (getattr(module, base),), {}))
    for name in (
        "ConnectionRefusedException",
        "TimeoutException",
        "CommunicatorDestroyedException",
        "RequestFailedException",
        "UnknownException",
        "MarshalException",
        "ConnectTimeoutException",
        "InvocationTimeoutException",
    ):
        base = "TimeoutException" if "TimeoutE" in name and hasattr(module, "TimeoutException") else "LocalException"
        setattr(module, name, type(name, (getattr(module, base),), {}))
    module.OperationNotExistException = type(  # type: ignore[attr-defined]
        "OperationNotExistException", (module.RequestFailedException,), {}
    )
    module.identityToString = str  # type: ignore[attr-defined]
    return {"Ice": module, "IceStorm": storm}


ZEROC = _zeroc()


class Failure(errors.RemoteFailure):
    """One that can be copied."""

    def __init__(self, reason: str) -> None:
        super().__init__("op", "E", reason)
        self.args = (reason,)


@pytest.mark.parametrize(
    ("ours", "theirs"),
    [
        (errors.Unreachable("gone"), "ConnectionRefusedException"),
        (errors.Timeout("late"), "TimeoutException"),
        (errors.Closed("over"), "CommunicatorDestroyedException"),
        (errors.ContractMismatch("other"), "OperationNotExistException"),
        (errors.Refused("no"), "RequestFailedException"),
        (errors.Busy("busy"), "LocalException"),
        (Failure("why"), "UnknownException"),
        (errors.EncodeError("wrong"), "MarshalException"),
        (errors.ConfigurationError("set"), "Exception"),
    ],
)
@pytest.mark.parametrize("find", [lambda name: None, lambda name: ZEROC.get(name)], ids=["without", "with"])
def test_errors_of_ours_become_those_of_ice(ours: Any, theirs: str, find: Any) -> None:
    ices = Ices("one", find)
    exc = copy.copy(ours)
    text, kind = str(exc), type(exc)
    raised = ices.raised(exc)
    assert raised is exc
    assert isinstance(exc, getattr(ices.ice, theirs))
    assert isinstance(exc, ices.ice.Exception)
    assert isinstance(exc, kind)
    assert (str(exc), exc.reason) == (text, getattr(ours, "reason", text))
    assert type(ices.raised(exc)) is type(exc)


@pytest.mark.parametrize(
    ("text", "uses"),
    [
        ("except Ice.Exception as e: pass\nIce.loadSlice('-I.')", False),
        ("except Ice.ConnectionRefusedException: pass  # Icecream.melts", False),
        ("ic = Ice.initialize(sys.argv)", True),
        ("IceStorm.TopicManagerPrx.checkedCast(proxy)", True),
    ],
)
def test_only_code_that_does_more_than_catch_ices_exceptions_needs_ice(text: str, uses: bool) -> None:
    assert uses_ice(text) == uses


@pytest.mark.tool
def test_errors_of_ours_become_those_of_the_real_ice() -> None:
    ices = Ices("one", real)
    theirs = importlib.import_module("Ice")
    assert ices.ice.Exception is theirs.Exception
    exc = ices.raised(errors.Unreachable("gone"))
    assert isinstance(exc, theirs.ConnectionRefusedException | errors.Unreachable)
    assert (str(exc), repr(exc)) == ("gone", "Unreachable('gone')")


def test_what_else_ice_has_is_there_if_it_is_installed() -> None:
    assert Ices("one", ZEROC.get).ice.identityToString is str
    bare = Ices("one", lambda name: None).ice
    assert bare.loadSlice("-I. --all Laser.ice") is None
    with pytest.raises(AttributeError, match=r"Ice\.initialize needs ZeroC Ice, which is not installed"):
        bare.initialize()


# Against slice2py itself.


@pytest.mark.tool
def test_types_are_those_of_slice2py(
    given: dict[str, ModuleType], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("Arm.idsl", "Frame.idsl"):
        (tmp_path / name).write_text(OF_2021.files[name])
    assert rcgen(["--to", "slice", "-o", str(tmp_path), str(tmp_path / "Arm.idsl")]) == 0
    files = sorted(str(path) for path in tmp_path.glob("*.ice"))
    subprocess.run(["slice2py", f"-I{tmp_path}", "--output-dir", str(tmp_path), *files], check=True)
    monkeypatch.syspath_prepend(str(tmp_path))
    before = set(sys.modules)
    try:
        theirs = __import__("RoboCompArm")
        for name in ("Joint", "Stuck"):
            ours = getattr(given["RoboCompArm"], name)
            assert _described(ours) == _described(getattr(theirs, name))
        assert [each.name for each in given["RoboCompArm"].Mode] == [
            theirs.Mode.valueOf(number).name for number in range(3)
        ]
        for number in range(3):
            mine, other = (module.Mode.valueOf(number) for module in (given["RoboCompArm"], theirs))
            assert (mine.value, str(mine)) == (other.value, str(other))
        assert given["RoboCompArm"].Joint() == given["RoboCompArm"].Joint()
        assert theirs.Joint() == theirs.Joint()
    finally:
        for name in set(sys.modules) - before:
            if name.startswith("RoboComp") or name in ("Arm_ice", "Frame_ice"):
                del sys.modules[name]


def _described(kind: type[Any]) -> list[tuple[str, Any]]:
    """The parameters of a constructor, and what a value has in their place without them."""
    value = kind()
    names = list(inspect.signature(kind).parameters)
    return [(name, _plain(getattr(value, name))) for name in names]


def _plain(value: Any) -> Any:
    return str(value) if type(value).__name__ == "Mode" else value
