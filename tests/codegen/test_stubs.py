"""What an existing specificworker.py still has to get."""

from __future__ import annotations

import ast
from functools import cache

import pytest

from robocomp_py.codegen.generate import Model
from robocomp_py.codegen.stubs import Stubs, find_stubs

from .generated import MODELS, artifacts, linked


@cache
def everything() -> Model:
    return linked(MODELS / "everything.cdsl")


@cache
def whole() -> str:
    return next(each.text for each in artifacts("everything") if str(each.path) == "specificworker.py")


def without(method: str) -> str:
    """The specificworker.py of `everything` without one of its methods."""
    tree = ast.parse(whole())
    [worker] = [node for node in tree.body if isinstance(node, ast.ClassDef)]
    worker.body = [node for node in worker.body if getattr(node, "name", "") != method]
    return ast.unparse(tree)


def stubs(source: str) -> Stubs:
    return find_stubs(source, everything())


def test_a_generated_specific_part_lacks_nothing() -> None:
    assert stubs(whole()) == Stubs({}, {}, "")


def test_a_missing_handler_comes_as_a_method_to_paste() -> None:
    found = stubs(without("Store_count"))
    assert found == Stubs(
        {
            "Store_count": (
                "    def Store_count(self) -> int:\n"
                '        """`count` of Everything.Store.\n\n'
                "        IDSL: idempotent int count()\n"
                '        """\n'
                "        return 0\n"
            )
        },
        {},
        "",
    )


def test_a_stub_brings_the_imports_that_are_not_there_yet() -> None:
    source = "class SpecificWorker(GenericWorker):\n    pass\n"
    found = stubs(source)
    assert found.imports == (
        "import numpy as np\nfrom numpy.typing import NDArray\n\nfrom .generic import Everything, Shapes\n"
    )
    pasted = f"{found.imports}\n{source}\n" + "\n".join(found.missing.values())
    assert stubs(pasted) == Stubs({}, {}, "")


@pytest.mark.parametrize(
    ("begins", "fits"),
    [
        ("def Store_check(self, fail, late)", True),
        ("def Store_check(self, one, other, third=None)", True),
        ("def Store_check(self, *values)", True),
        ("def Store_check(self, fail, late, *, deadline=1)", True),
        ("def Store_check(self, fail, /, late)", True),
        ("def Store_check(self)", False),
        ("def Store_check(self, fail)", False),
        ("def Store_check(self, fail, late, third)", False),
        ("def Store_check(self, fail, late, *, deadline)", False),
    ],
)
def test_a_handler_has_to_take_what_it_is_given(begins: str, fits: bool) -> None:
    found = stubs(without("Store_check") + f"\n    {begins}: pass\n")
    assert found.missing == {}
    wanted = "def Store_check(self, fail: bool, late: bool) -> None:"
    assert found.unfit == ({} if fits else {"Store_check": wanted})


@pytest.mark.parametrize(
    ("statement", "gone"),
    [
        ("from .generic import Shapes, Old, Older", ("Old", "Older")),
        ("from .generic.Old import Thing", ("Old",)),
        ("from .generic import *", ()),
        ("from .generic.params import Params", ()),
        ("from .other import Old", ()),
        ("import generic.Old", ()),
    ],
)
def test_modules_that_are_not_generated_any_more_are_named(statement: str, gone: tuple[str, ...]) -> None:
    assert stubs(whole().replace("import numpy as np", f"import numpy as np\n{statement}")).gone == gone


@pytest.mark.parametrize(
    "binding",
    ["Store_count = helper", "Store_count: object = helper", "if True:\n        Store_count = 1", "async def f(): ..."],
)
def test_a_handler_need_not_be_a_plain_method(binding: str) -> None:
    found = stubs(without("Store_count") + f"\n    {binding.replace('f()', 'Store_count(self)')}\n")
    assert found.missing == {}


@pytest.mark.parametrize(
    "source",
    ["", "def (", "\0", "class Other: pass", "class SpecificWorker(Mixin, GenericWorker): pass"],
    ids=["empty", "no Python", "zero", "no worker", "mixin"],
)
def test_what_cannot_be_judged_is_left_to_the_start_of_the_component(source: str) -> None:
    assert stubs(source) == Stubs({}, {}, "")
