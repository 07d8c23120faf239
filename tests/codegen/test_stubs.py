"""What an existing specificworker.py still has to get."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

import pytest

from robocomp_py.codegen.generate import GenerationError, Model
from robocomp_py.codegen.stubs import Stubs, find_stubs, with_stubs
from robocomp_py.usercode.reading import Read

from .generated import artifacts, golden_model


@cache
def everything() -> Model:
    return golden_model("everything")


@cache
def whole() -> str:
    return next(each.text for each in artifacts("everything") if str(each.path) == "specificworker.py")


def without(method: str) -> str:
    """The specificworker.py of `everything` without one of its methods."""
    tree = ast.parse(whole())
    [worker] = [node for node in tree.body if isinstance(node, ast.ClassDef)]
    worker.body = [node for node in worker.body if getattr(node, "name", "") != method]
    return ast.unparse(tree)


def stubs(source: str, **others: str) -> Stubs:
    """What a specificworker.py lacks; `others` are the files beside it."""
    return find_stubs(Path("everything"), everything(), reading({"specificworker": source, **others}))


def reading(files: dict[str, str]) -> Read:
    """Reads these modules of a folder `everything`."""
    texts = {Path("everything") / f"{name.replace('__', '/')}.py": text.encode() for name, text in files.items()}

    def read(path: Path) -> bytes:
        if path not in texts:
            raise FileNotFoundError(path)
        return texts[path]

    return read


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


HEAD = """\
'''Mine.'''

from __future__ import annotations

import random

from .generic.genericworker import GenericWorker
"""


@pytest.mark.parametrize(
    "body",
    [
        "\n\nclass SpecificWorker(GenericWorker):\n    pass\n",
        '\n\nclass SpecificWorker(GenericWorker):\n    """Docs."""  # and more\n    # the end',
        "\n\nclass SpecificWorker(GenericWorker):\n\tdef compute(self):\n\t\tpass\n\nclass After: pass\n",
        "\r\nclass SpecificWorker(GenericWorker):\r\n  x = '''\r\n  '''\r\nprint(random)\r\n",
        "\nif True:\n    class SpecificWorker(GenericWorker):\n        def compute(self): pass\n    # behind\n",
    ],
    ids=["pass", "docstring only", "tabs, not last", "other line ends", "indented"],
)
def test_stubs_are_appended_to_the_class_and_nothing_else_changes(body: str) -> None:
    before = (HEAD.replace("\n", "\r\n") if "\r" in body else HEAD) + body
    folder, read = Path("everything"), reading({"specificworker": before})
    missing = find_stubs(folder, everything(), read)
    after = with_stubs(folder, missing, read).decode()
    assert stubs(after) == Stubs({}, {}, "")
    assert after.count("\r\n") == (after.count("\n") if "\r" in body else 0)
    kept = [line for line in before.splitlines() if line.strip() != "pass" or "\t" in line]
    assert [line for line in after.splitlines() if line in kept and line] == [line for line in kept if line]
    assert set(missing.missing) <= {node.name for node in ast.walk(ast.parse(after)) if hasattr(node, "name")}


def test_stubs_in_a_generated_specific_part_make_it_what_rcgen_would_have_written(tmp_path: Path) -> None:
    """To the byte, if the methods that were added are the last ones: linters find nothing in the imports either."""
    [worker] = [node for node in ast.parse(whole()).body if isinstance(node, ast.ClassDef)]
    methods = [node for node in worker.body if isinstance(node, ast.FunctionDef)]
    for number in (1, 3, len(methods) - 3):
        lines = whole().splitlines()
        del lines[methods[-number].lineno - 2 :]
        text = "\n".join(lines) + "\n"
        read = reading({"specificworker": text})
        assert (
            with_stubs(Path("everything"), find_stubs(Path("everything"), everything(), read), read).decode() == whole()
        )


def test_the_method_of_a_timer_comes_as_a_stub() -> None:
    text = next(each.text for each in artifacts("patrol") if str(each.path) == "specificworker.py")
    read = reading({"specificworker": text[: text.index("\n    def timer_report")]})
    patrol = golden_model("patrol")
    found = find_stubs(Path("everything"), patrol, read)
    assert list(found.missing) == ["timer_report"]
    assert with_stubs(Path("everything"), found, read).decode() == text


@pytest.mark.parametrize("text", ["class SpecificWorker(GenericWorker): pass", "from .mine import SpecificWorker"])
def test_a_class_that_nothing_can_be_appended_to_is_refused(text: str) -> None:
    read = reading({"specificworker": text, "mine": "class SpecificWorker(GenericWorker):\n    pass\n"})
    with pytest.raises(GenerationError):
        with_stubs(Path("everything"), find_stubs(Path("everything"), everything(), read), read)
