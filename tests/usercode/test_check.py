"""What reading a specific part tells about it, and what it leaves to the start of the component."""

from __future__ import annotations

from pathlib import Path

import pytest

from robocomp_py.dsl.diagnostics import Diagnostic
from robocomp_py.dsl.workspace import Workspace, read_file
from robocomp_py.runtime import worker as runtime
from robocomp_py.usercode.check import HOOKS, complaints

FOLDER = Path("/nowhere/vault")
CDSL = """
import "Vault.idsl";
Component vault
{
    Communications { implements Vault; };
    language python;
    statemachine "vault.smdsl";
};
"""
IDSL = "module RoboCompVault { interface Vault { int count(); void store(string item); }; };"
SMDSL = "vault { states open; initial_state closed; transitions { closed => open; open => closed; }; };"
STATES = "    def sm_open(self): pass\n    def sm_closed(self): pass\n"
COUNT = "    def Vault_count(self): return 0\n"
STORE = "    def Vault_store(self, item): pass\n"
WHOLE = COUNT + STORE + STATES
HEAD = "from .generic.genericworker import GenericWorker\n"


def found(
    body: str,
    head: str = f"{HEAD}class SpecificWorker(GenericWorker):",
    *,
    folder: Path = FOLDER,
    cdsl: str = CDSL,
    idsl: str = IDSL,
    **others: str,
) -> list[Diagnostic]:
    """What is said of a specific part whose class has that body; `others` are the files beside it."""
    texts = {"vault.cdsl": cdsl, "Vault.idsl": idsl, "vault.smdsl": SMDSL, "specificworker.py": f"{head}\n{body}"}
    texts |= {f"{name}.py": text for name, text in others.items()}
    files = {folder / name: text.encode() for name, text in texts.items()}
    workspace = Workspace(read=lambda path: files[path] if path in files else read_file(path))
    linked = workspace.component(folder / "vault.cdsl")
    assert linked, "\n".join(each.render() for each in workspace.report.diagnostics)
    return complaints(linked, workspace)


def test_a_complete_specific_part_has_no_findings() -> None:
    assert found(WHOLE) == []


def test_missing_methods_are_reported_at_the_clauses_that_need_them() -> None:
    diagnostics = found("    pass\n")
    assert [(each.code, each.message) for each in diagnostics] == [
        (
            "missing-handler",
            "`SpecificWorker` lacks `Vault_count` and `Vault_store`, which `implements Vault` asks for",
        ),
        (
            "missing-handler",
            "`SpecificWorker` lacks `sm_closed` and `sm_open`, which `statemachine vault.smdsl` asks for",
        ),
    ]
    assert {each.hint for each in diagnostics} == {f"run: rcgen --stubs {FOLDER / 'vault.cdsl'}"}
    assert {each.span.text for each in diagnostics} == {"SpecificWorker"}
    assert [span.text for each in diagnostics for _, span in each.related] == ["Vault", "vault.smdsl"]


def test_the_methods_of_timers_are_checked() -> None:
    timed = CDSL.replace("    language", "    timer poll 20 ms;\n    timer report 1 s;\n    language")
    lacks, uncalled = found(WHOLE + "    def timer_poll(self): pass\n    def timer_repot(self): pass\n", cdsl=timed)
    assert lacks.message == "`SpecificWorker` lacks `timer_report`, which `timer report` asks for"
    assert lacks.hint.startswith("rename `timer_repot` to `timer_report`, or run: rcgen --stubs")
    assert (uncalled.code, uncalled.message) == ("uncalled-handler", "`timer_repot` is not called by anything")
    [wrong] = found(WHOLE + "    def timer_poll(self, now): pass\n    def timer_report(self): pass\n", cdsl=timed)
    assert (wrong.code, wrong.hint) == ("wrong-handler", "write `def timer_poll(self)`")


@pytest.mark.parametrize(
    ("method", "says"),
    [
        ("def Vault_store(self): pass", "`Vault_store` does not take what it is given: item"),
        ("def Vault_store(self, item, place): pass", "`Vault_store` does not take what it is given: item"),
        ("def Vault_store(self, item, *, place): pass", "`Vault_store` does not take what it is given: item"),
        ("async def Vault_store(self, item): pass", "`Vault_store` is `async def`, but the framework calls it as an"),
        ("def Vault_store(self, item, place=None): pass", ""),
        ("def Vault_store(self, *items): pass", ""),
        ("@cached\n    def Vault_store(self): pass", ""),
        ("@staticmethod\n    def Vault_store(item): pass", ""),
        ("Vault_store = helper", ""),
        ("def Vault_store(self): pass\n    Vault_store = wrapped(Vault_store)", ""),
        ("def Vault_store(self): pass\nSpecificWorker.Vault_store = wrapped(SpecificWorker.Vault_store)", ""),
        ("def compute(self, dt): pass\n" + STORE, "`compute` does not take what it is given: nothing"),
    ],
)
def test_a_method_has_to_take_what_it_is_given(method: str, says: str) -> None:
    diagnostics = found(COUNT + STATES + f"    {method}\n")
    assert [each.code for each in diagnostics] == (["wrong-handler"] if says else [])
    assert all(each.message.startswith(says) for each in diagnostics)


@pytest.mark.parametrize(
    ("body", "is_right"),
    [
        ("yield", True),
        ("while True:\n            yield", True),
        ("return (yield from self.steps(goal))", True),
        ("return 0", False),
        ("def steps():\n            yield\n        return 0", False),
        ("return list(map(lambda x: (yield x), range(3)))", False),
    ],
)
def test_the_handler_of_an_action_has_to_yield(body: str, is_right: bool) -> None:
    idsl = IDSL.replace("int count", "[action] int fill(string item); int count")
    method = f"    def Vault_fill(self, goal, item):\n        {body}\n"
    diagnostics = found(WHOLE + method, idsl=idsl)
    assert [(each.code, each.message) for each in diagnostics] == (
        [] if is_right else [("wrong-handler", "`Vault_fill` executes an action, but has no `yield`")]
    )


def test_an_old_handler_is_reported_with_its_possible_new_name() -> None:
    [missing, uncalled] = found(STORE + STATES + "    def Vault_size(self): return 0\n")
    assert (missing.code, uncalled.code, uncalled.severity) == ("missing-handler", "uncalled-handler", "warning")
    assert uncalled.message == "`Vault_size` is not called by anything"
    assert uncalled.hint == "was it renamed to `Vault_count`?"
    assert uncalled.span.text == "Vault_size"


def test_a_slip_in_a_name_is_seen() -> None:
    missing, _ = found(
        STORE + STATES + "    def Vault_cuont(self): return 0\n    def compute(self): self.Vault_cuont()\n"
    )
    assert missing.hint.startswith("rename `Vault_cuont` to `Vault_count`, or run: rcgen --stubs ")


@pytest.mark.parametrize(
    ("body", "others"),
    [
        ("    def compute(self): self.Vault_check()\n", {}),
        ("    def compute(self): getattr(self, 'Vault_check')()\n", {}),
        ("    def compute(self): getattr(self, self.name)()\n", {}),
        ("", {"helpers": "def check(worker): worker.Vault_check()"}),
        ("", {"tests/test_vault": "'Vault_check'"}),
    ],
    ids=["called", "by name", "by a computed name", "elsewhere", "in a test"],
)
def test_a_method_that_code_mentions_is_no_old_handler(body: str, others: dict[str, str], tmp_path: Path) -> None:
    for name in ("specificworker", *others):  # which files there are is told by the disk
        path = tmp_path / f"{name}.py"
        path.parent.mkdir(exist_ok=True)
        path.touch()
    handlers = WHOLE + "    def Vault_check(self): pass\n"
    assert [each.code for each in found(handlers, folder=tmp_path)] == ["uncalled-handler"]
    assert found(handlers + body, folder=tmp_path, **others) == []


M = f"class M:\n{WHOLE}"
MINE = f"from .generic import genericworker as g\nclass GenericWorker(g.GenericWorker):\n{WHOLE}"
GENERIC = {"generic/__init__": "", "generic/genericworker": "class GenericWorker(Worker[None]): pass"}
MIXIN = f"class Mixin:\n{WHOLE}"


@pytest.mark.parametrize(
    ("imports", "bases", "others"),
    [
        ("from .mixins import Mixin", "Mixin, GenericWorker", {"mixins": MIXIN}),
        ("from . import mixins", "mixins.Mixin, GenericWorker", {"mixins": MIXIN}),
        ("from .parts.mixins import Mixin as M", "M, GenericWorker", {"parts/mixins": MIXIN}),
        (
            "from .parts import Mixin",
            "Mixin, GenericWorker",
            {"parts/__init__": "from .all import *", "parts/all": MIXIN},
        ),
        ("from vault.mixins import Mixin", "Mixin, GenericWorker", {"mixins": MIXIN}),
        ("from .mixins import *", "Mixin, GenericWorker", {"mixins": MIXIN}),
        ("from .base import Base", "Base", {"base": f"{HEAD}class Base(GenericWorker):\n{WHOLE}"}),
        (MIXIN, "Mixin, GenericWorker", {}),
        ("from .mine import GenericWorker", "GenericWorker", {"mine": MINE}),
        ("from .mine import *", "GenericWorker", {"mine": MINE}),
        ("from .generic import genericworker\nfrom .m import M", "M, genericworker.GenericWorker", GENERIC | {"m": M}),
    ],
)
def test_bases_are_followed_through_the_files_of_the_component(
    imports: str, bases: str, others: dict[str, str]
) -> None:
    head = f"{imports if 'import GenericWorker' in imports or '*' in imports else HEAD + imports}"
    head += f"\nclass SpecificWorker({bases}):"
    assert found("    pass\n", head, **others) == []
    without = {name: text.replace(COUNT, "    pass\n") for name, text in others.items()}
    codes = [each.code for each in found("    pass\n", head.replace(COUNT, "    pass\n"), **without)]
    assert codes == ["missing-handler"]


def test_a_mixin_behind_the_generic_worker_has_no_effect() -> None:
    [first, _] = found("    pass\n", f"{HEAD}{MIXIN}\nclass SpecificWorker(GenericWorker, Mixin):")
    assert first.hint == "name the class Mixin in front of GenericWorker, whose own methods are empty"


@pytest.mark.parametrize(
    "text",
    [
        "from library import Mixin\nclass SpecificWorker(Mixin, GenericWorker): pass",
        "from .nowhere import Mixin\nclass SpecificWorker(Mixin, GenericWorker): pass",
        "class SpecificWorker(mixin(), GenericWorker): pass",
        "class SpecificWorker(GenericWorker, metaclass=Meta): pass",
        "@registered\nclass SpecificWorker(GenericWorker): pass",
        "class SpecificWorker(GenericWorker):\n    def __getattr__(self, name): pass",
        "class Base(GenericWorker):\n    def __init_subclass__(cls): pass\nclass SpecificWorker(Base): pass",
        "class SpecificWorker(GenericWorker): pass\nfor each in names: setattr(SpecificWorker, each, helper)",
        "try:\n    from x import B\nexcept ImportError:\n    B = object\nclass SpecificWorker(B, GenericWorker): pass",
        "if fast:\n    class SpecificWorker(GenericWorker): pass\nelse:\n    class SpecificWorker(GenericWorker): pass",
        "class SpecificWorker(GenericWorker):\n    locals().update(handlers())",
        "SpecificWorker = make(GenericWorker)",
        "from library import SpecificWorker",
        "class SpecificWorker(SpecificWorker): pass",
        "",
    ],
)
def test_what_reading_cannot_tell_is_left_to_the_start_of_the_component(text: str) -> None:
    assert found("", f"{HEAD}{text}") == []


@pytest.mark.parametrize(
    "body",
    [
        "    Vault_count = Vault_store = sm_open = sm_closed = helper\n",
        "    Vault_count, Vault_store, *rest = make()\n    sm_open: object = helper\n    from x import sm_closed\n",
        "    if fast:\n        def Vault_count(self): pass\n    else:\n        def Vault_count(self, x): pass\n"
        + STORE
        + STATES,
        "    def __init__(self):\n        self.Vault_count = self.Vault_store = helper\n" + STATES,
    ],
)
def test_a_handler_may_be_anything_that_is_assigned(body: str) -> None:
    assert found(body) == []


def test_methods_that_are_assigned_from_outside_count() -> None:
    assert found("    pass\nSpecificWorker.Vault_count = helper\n" + "") != []
    head = f"{HEAD}class SpecificWorker(GenericWorker):"
    after = "".join(
        f"SpecificWorker.{name} = helper\n" for name in ("Vault_count", "Vault_store", "sm_open", "sm_closed")
    )
    assert found(f"    pass\n{after}", head) == []


def test_invalid_python_is_reported() -> None:
    [diagnostic] = found("    def Vault_count(self:\n")
    assert (diagnostic.code, diagnostic.span.source.position(diagnostic.span.start)[0]) == ("python-syntax", 3)


def test_hooks_are_those_of_the_run_time() -> None:
    assert set(runtime.HOOKS) < HOOKS.keys()
    for name, arguments in HOOKS.items():
        code = getattr(runtime.Worker, name).__code__
        assert code.co_varnames[1 : code.co_argcount] == arguments


@pytest.mark.parametrize(
    ("statement", "module"),
    [
        ("from .generic import RoboCompVault, Old", "Old"),
        ("from .generic.Old import Thing", "from .generic.Old import Thing"),
        ("from .generic import *", ""),
        ("from .generic.params import Params", ""),
        ("from .other import Old", ""),
        ("try:\n    from .generic import Old\nexcept ImportError:\n    pass", ""),
    ],
)
def test_a_module_that_is_not_generated_is_reported(statement: str, module: str) -> None:
    generic = {f"generic/{name}": "" for name in ("genericworker", "params", "RoboCompVault")}
    head = f"{HEAD}{statement}\nclass SpecificWorker(GenericWorker):"
    diagnostics = found(WHOLE, head, **generic)
    assert [(each.code, each.span.text) for each in diagnostics] == ([("missing-module", module)] if module else [])
    assert found(WHOLE, head) == []  # nothing is generated yet


@pytest.mark.parametrize(
    ("written", "meant"), [("comptue", "compute"), ("inizialize", "initialize"), ("finsh", "finish")]
)
def test_a_misspelt_hook_that_nothing_calls_is_a_warning(written: str, meant: str) -> None:
    (warning,) = found(f"{WHOLE}    def {written}(self): pass\n")
    assert (warning.code, warning.message) == ("uncalled-handler", f"`{written}` is not called by anything")
    assert warning.hint == f"did you mean `{meant}`, which the framework calls?"


def test_a_method_with_a_name_like_that_of_a_hook_is_none_if_it_is_called(tmp_path: Path) -> None:
    body = f"{WHOLE}    def computed(self): pass\n    def finish(self): self.computed()\n"
    (tmp_path / "specificworker.py").write_text(f"class SpecificWorker:\n{body}")
    assert found(body, folder=tmp_path) == []


def test_a_method_with_a_name_like_that_of_a_hook_is_none_if_the_hook_is_there() -> None:
    assert found(f"{WHOLE}    def computed(self): pass\n    def compute(self): pass\n") == []
