"""What generated code does when it runs."""

from __future__ import annotations

import dataclasses
import enum
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from robocomp_py.cli.rcgen import main as rcgen
from robocomp_py.codegen.generate import GenerationError, generate_module
from robocomp_py.contract import types as t
from robocomp_py.contract.interface import Interface
from robocomp_py.contract.module import Constant, Module
from robocomp_py.errors import ConfigurationError, DeclaredError
from robocomp_py.runtime.worker import Worker
from robocomp_py.testing.components import ComponentTest

from .generated import NAMES, golden_model, loaded, model_in, module_of
from .golden import GOLDEN

WORKERS = {name: loaded(GOLDEN / name) for name in NAMES}


def module(name: str, component: str = "everything") -> ModuleType:
    return module_of(WORKERS[component], name)


EVERYTHING = module("Everything")


def bare(value: Any) -> Any:
    """A contract without the Python classes it carries, which no text of a model can have."""
    if isinstance(value, tuple):
        return tuple(map(bare, value))
    if not dataclasses.is_dataclass(value) or isinstance(value, type):
        return value
    kept = {each.name: bare(getattr(value, each.name)) for each in dataclasses.fields(value) if each.name != "python"}
    return type(value)(**kept)


# Contracts.


@pytest.mark.parametrize("name", NAMES)
def test_the_generated_component_is_the_linked_one(name: str) -> None:
    model = golden_model(name)
    assert bare(WORKERS[name].component) == bare(dataclasses.replace(model.component, description=""))
    found = [operation.fingerprint for port in WORKERS[name].component.ports for operation in port.interface.operations]
    assert found == [o.fingerprint for port in model.component.ports for o in port.interface.operations]


@pytest.mark.parametrize(("component", "name"), [(c, m.name) for c in NAMES for m in golden_model(c).modules])
def test_every_definition_is_in_its_module_and_carries_its_contract(component: str, name: str) -> None:
    model = next(each for each in golden_model(component).modules if each.name == name)
    python = module(name if name.isidentifier() and name not in ("class", "lambda") else f"{name}_", component)
    contracts = {
        value.__contract__.name: value
        for value in vars(python).values()
        if isinstance(value, type) and hasattr(value, "__contract__") and value.__module__ == python.__name__
    }
    interfaces = {value.name: value for value in vars(python).values() if isinstance(value, Interface)}
    for definition in model.definitions:
        match definition:
            case t.Struct() | t.Enumeration() | t.ExceptionType():
                made = contracts[definition.name]
                assert bare(made.__contract__) == bare(definition)
                assert made.__contract__.python is made
            case Interface():
                assert bare(interfaces[definition.name]) == bare(definition)
            case t.Sequence() | t.Dictionary() | Constant():
                short = definition.name.rpartition("::")[2]
                assert hasattr(python, short) or hasattr(python, f"{short}_")


def test_what_no_check_of_the_languages_has_found_is_refused_at_last() -> None:
    """Two names in one module of Python would leave one of them unseen."""
    clash = Module("Arm", (t.Struct("Arm::ARM_INTERFACE", ()), Interface("Arm::Arm", ())), ("Arm.idsl",))
    with pytest.raises(GenerationError, match=r"Arm\.idsl: two definitions would be named `ARM_INTERFACE` in Python"):
        generate_module(clash)


# Types.


def test_structs_are_dataclasses_with_slots_and_the_values_their_idsl_gives() -> None:
    widths = EVERYTHING.Widths()
    assert not hasattr(widths, "__dict__")
    assert dataclasses.astuple(widths) == (True, 0, 0, 0, 0, 0, 0, 0, 255, 1.5, 0.001, 0)
    inner = EVERYTHING.Slice()
    assert (inner.c, inner.g, inner.h) == (-7, "unnamed", EVERYTHING.Level.high)
    assert inner.i == module("Shapes").Point(0.0, 0.0)
    with pytest.raises(AttributeError):
        widths.yess = False


def test_no_two_values_share_what_can_be_changed() -> None:
    one, other = EVERYTHING.Containers(), EVERYTHING.Containers()
    for each in dataclasses.fields(one):
        assert getattr(one, each.name) is not getattr(other, each.name)
    assert EVERYTHING.Slice().i is not EVERYTHING.Slice().i


def test_zeros_of_containers_are_empty_and_of_their_type() -> None:
    zero = EVERYTHING.Containers()
    arrays = {"numbers": np.float32, "flags": np.bool_, "raw": np.uint8}
    for each in dataclasses.fields(zero):
        value = getattr(zero, each.name)
        assert len(value) == 0
        if each.name in arrays:
            assert (type(value), value.dtype) == (np.ndarray, arrays[each.name])
        else:
            assert type(value) is (dict if each.name in ("byName", "byLevel", "nothings") else list)


def test_enumerations_are_integers_with_names() -> None:
    level = EVERYTHING.Level
    assert issubclass(level, enum.IntEnum)
    assert {each.name: each.value for each in level} == {"low": -1, "medium": 5, "high": 6}
    assert level(5) is level.medium


def test_exceptions_can_be_raised_with_their_fields_and_caught_as_their_bases() -> None:
    with pytest.raises(EVERYTHING.Failed) as raised:
        raise EVERYTHING.Late("too slow", since=7)
    late = raised.value
    assert isinstance(late, DeclaredError)
    assert (late.why, late.code, late.since, len(late.measured)) == ("too slow", 1, 7, 0)
    assert "too slow" in str(late)
    assert late != EVERYTHING.Late("too slow", since=7), "as all exceptions, equal to itself only"


def test_constants_have_their_values() -> None:
    found = [getattr(EVERYTHING, name) for name in ("limit", "half", "greeting", "usual", "epoch")]
    assert found == [10, 0.5, "say \\ hello", EVERYTHING.Level.medium, 0]


def test_names_of_python_get_an_underscore_and_keep_their_name_in_the_contract() -> None:
    odd = module("class_", "names")
    assert [each.name for each in dataclasses.fields(odd.Field_)][:2] == ["lambda_", "from_"]
    assert [each.name for each in odd.Field_.__contract__.fields][:2] == ["lambda", "from"]


# Parameters.


def test_parameters_are_read_only_and_keep_their_ranges() -> None:
    params = module("params").Params
    assert params().rate == 10
    assert params(rate=7).rate == 7
    with pytest.raises(dataclasses.FrozenInstanceError):
        params().rate = 8
    with pytest.raises(ConfigurationError, match="rate"):
        params(rate=1001)


# Components.


@pytest.mark.parametrize("name", NAMES)
def test_a_generated_component_runs_as_it_is(name: str) -> None:
    config = {"params.device": "/dev/null"} if name == "everything" else {}
    with ComponentTest(WORKERS[name], config) as component:
        component.wait_for_computes(2)
    assert component.fine


def test_generated_handlers_answer_with_zeros_through_generated_proxies() -> None:
    with ComponentTest(WORKERS["everything"], {"params.device": "/dev/null"}) as component:
        assert component.call("Store.count") == 0
        assert component.call("Store.widths", EVERYTHING.Widths(a=3)) == EVERYTHING.Widths()
        assert component.call("Store.slices", []) == ([], 0, module("Shapes").Point())
        assert component.worker.store_proxy.count() == 0
        assert component.worker.store1_proxy.countAsync().result(10) == 0
        component.worker.news_proxy.told("news", [1.0])
        component.wait_for(lambda: component.received("news.told"))
    [(what, values)] = component.received("news.told")
    assert (what, list(values)) == ("news", [1.0])


def test_generated_loans_are_messages_to_fill() -> None:
    with ComponentTest(WORKERS["everything"], {"params.device": "/dev/null"}) as component:
        proxy = component.worker.news_proxy
        with proxy.loanTold(3) as told:
            told.what = "news"
            told.values[:] = 1.0
        with proxy.loanKept(raw=(2, 2)) as kept:
            kept.raw[:] = 7
        with proxy.loanCompared(left_numbers=2, numbers=1, deadline=5.0) as compared:
            compared.left.numbers[:] = compared.numbers[:] = 0.5
        component.wait_for(lambda: component.received("news.compared"))
    [(what, values)] = component.received("news.told")
    assert (what, list(values)) == ("news", [1.0] * 3)
    [(received,)] = component.received("news.kept")
    assert isinstance(kept, EVERYTHING.Containers)
    assert list(received.raw) == [7] * 4
    [(left, right, numbers)] = component.received("news.compared")
    assert [list(each) for each in (left.numbers, right.numbers, numbers)] == [[0.5] * 2, [], [0.5]]


def test_a_generated_component_can_be_imported_as_a_package(tmp_path: Path) -> None:
    """A folder of any name, beside another one of the same component."""
    for folder in ("my plain-component", "class"):
        (tmp_path / folder).symlink_to(GOLDEN / "plain")
        worker = loaded(tmp_path / folder)
        assert issubclass(worker, Worker)


def test_a_description_begins_with_a_capital_unless_it_begins_with_a_name(tmp_path: Path) -> None:
    idsl = """module RoboCompArm {
        // ry is the orientation.
        struct Pose { float x; float ry; };
        // where something is
        struct Place { float x; };
        // off is the default
        enum Mode { off, on };
        interface Arm {
            // move goes on at once
            void move(Pose to);
            // to is where it ends
            void push(Pose to);
            // all of it
            Pose where();
        };
    };"""
    cdsl = """import "Arm.idsl";
        // arm moves things.
        Component arm { Communications { requires Arm; }; language python; };"""
    path = model_in(tmp_path / "arm", arm_cdsl=cdsl, Arm_idsl=idsl)
    assert rcgen([str(path)]) == 0
    worker = loaded(path.parent)
    made = module_of(worker, "RoboCompArm")
    said = [made.Pose, made.Place, made.Mode, made.ArmProxy.move, made.ArmProxy.push, made.ArmProxy.where]
    assert [each.__doc__.splitlines()[0] for each in said] == [
        *("ry is the orientation.", "Where something is.", "off is the default."),
        *("move goes on at once.", "to is where it ends.", "All of it."),
    ]
    assert worker.component.description == "arm moves things."
