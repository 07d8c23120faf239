"""Components that RoboComp's own generator made: their files stay, and what is understood of them is said."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from robocomp_py.classic.findings import Finding, Verdict, in_worker, listed
from robocomp_py.cli.rcgen import main as rcgen

from ..codegen.generated import linked, model_in, snapshot

CDSL = """\
import "Arm.idsl"; import "Hand.idsl";
Component arm
{
    Communications { implements Arm; requires Hand; publishes Touch; subscribesTo Stop; };
    language python;
    gui Qt(QWidget);
    params "arm.pdsl";
};
"""
ARM = """\
module RoboCompArm
{
    interface Arm { float where(int joint); void move(int joint, float to, out bool done); };
    interface Stop { void halt(); };
    interface Touch { void touched(float force); };
};
"""
HAND = "module RoboCompHand { interface Hand { void close(); void open(); }; };\n"
PDSL = "ComponentParams arm { speed float 0.5 0:2; };\n"
WORKER = """\
from genericworker import *
import interfaces as ifaces

class SpecificWorker(GenericWorker):
    def __init__(self, proxy_map, configData, startup_check=False):
        super(SpecificWorker, self).__init__(proxy_map, configData)
        self.timer.start(100)

    @QtCore.Slot()
    def compute(self):
        self.hand_proxy.close()
        self.touch_proxy.touched(1.0)

    def Arm_where(self, joint):
        return 0.5

    def Arm_move(self, joint, to):
        return True

    def Stop_halt(self):
        pass
"""
CONFIG = """\
# Endpoints for implemented interfaces
Arm.Endpoints=tcp -p 10020
HandProxy = hand:tcp -h localhost -p 10021
Period.Compute = 50
speed = 1.5
Ice.Warn.Connections=0
spead = 1
"""


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    """A component as RoboComp's users have it."""
    folder = tmp_path / "arm"
    model_in(folder, arm_cdsl=CDSL, Arm_idsl=ARM, Hand_idsl=HAND, arm_pdsl=PDSL)
    for name, text in (
        ("src/specificworker.py", WORKER),
        ("src/genericworker.py", "# theirs\n"),
        ("etc/config", CONFIG),
    ):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text)
    (folder / "CMakeLists.txt").write_text("# theirs\n")
    (folder / "README.md").write_text("# theirs\n")
    return folder


def findings(arm: Path, text: str) -> list[Finding]:
    return list(in_worker(text, linked(arm / "arm.cdsl").component))


def told(arm: Path, text: str, verdict: Verdict) -> dict[str, str]:
    return {each.what: each.text for each in findings(arm, text) if each.verdict is verdict}


# What is written.


@pytest.mark.parametrize("given", ["", "arm.cdsl"], ids=["the folder", "the model"])
def test_only_the_generic_part_is_added(arm: Path, given: str) -> None:
    before = snapshot(arm)
    assert rcgen([str(arm / given)]) == 0
    after = snapshot(arm)
    assert before.items() <= after.items()
    assert {name.partition("/")[0] for name in after.keys() - before.keys()} == {"generic"}
    assert rcgen(["--check", str(arm / given)]) == 0


def test_a_missing_configuration_is_written(arm: Path) -> None:
    (arm / "etc" / "config").unlink()
    assert rcgen([str(arm)]) == 0
    assert (arm / "etc" / "config.toml").is_file()
    assert not (arm / "specificworker.py").exists()


def test_a_component_of_ours_stays_one_whatever_else_it_has(arm: Path) -> None:
    (arm / "specificworker.py").write_text("# ours\n")
    assert rcgen([str(arm)]) == 0
    assert (arm / "__main__.py").is_file()


def test_a_folder_with_several_models_is_named_like_the_one_that_is_meant(
    arm: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (arm / "other.cdsl").write_text("Component other { };")
    assert rcgen([str(arm)]) == 0
    (arm / "arm.cdsl").rename(arm / "third.cdsl")
    assert rcgen([str(arm)]) == 1
    assert "should hold one .cdsl, but holds other.cdsl, third.cdsl" in capsys.readouterr().err


# What is said.


def test_the_report_tells_what_became_of_everything(arm: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert rcgen([str(arm)]) == 0
    report = capsys.readouterr().out.partition(":\n\n")[2]
    assert (
        _without_reasons(report)
        == """\
  arm.cdsl
    understood: implements Arm, requires Hand, publishes Touch, subscribesTo Stop, language python, gui Qt(QWidget), \
params "arm.pdsl"
  src/specificworker.py
    understood: Arm_where, Arm_move, Stop_halt, self.hand_proxy, self.touch_proxy
  etc/config
    understood: Period.Compute, speed
    without effect: line 2: Arm.Endpoints
    without effect: line 3: HandProxy
    without effect: line 6: Ice.Warn.Connections
    not understood: line 7: spead: unknown parameter `spead`; did you mean `speed`?
"""
    )


def _without_reasons(report: str) -> str:
    """Why something is without effect is said elsewhere, and tested there."""
    return re.sub(r"(without effect: line \d+: [^:]+): .*", r"\1", report)


def test_the_report_can_be_read_by_machines(arm: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert rcgen(["--json", str(arm)]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["component"], found["existing"]) == ("arm", True)
    assert {
        "file": "src/specificworker.py",
        "line": 14,
        "what": "Arm_where",
        "verdict": "understood",
        "text": "handles Arm.where",
    } in found["report"]


def test_a_configuration_in_the_form_of_2025_is_understood_likewise(
    arm: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (arm / "etc" / "config").rename(arm / "etc" / "config.toml")
    (arm / "etc" / "config.toml").write_text('[Endpoints]\nArm = "tcp -p 10020"\n[Period]\nCompute = 50\n')
    before = snapshot(arm)
    assert rcgen([str(arm)]) == 0
    assert before.items() <= snapshot(arm).items()
    report = capsys.readouterr().out.partition("  etc/config.toml\n")[2]
    assert _without_reasons(report) == "    understood: Period.Compute\n    without effect: line 2: Endpoints.Arm\n"


def test_a_configuration_that_cannot_be_read_is_said_to_be_so(arm: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (arm / "etc" / "config").write_text("[Period\nCompute = 50\n")
    assert rcgen([str(arm)]) == 0
    assert "not understood: line 1: the file: " in capsys.readouterr().out


def test_handlers_may_be_called_as_they_were_before_2018(arm: Path) -> None:
    older = WORKER.replace("Arm_where", "where").replace("Stop_halt", "halt")
    assert {"where", "Arm_move", "halt"} <= told(arm, older, Verdict.UNDERSTOOD).keys()


def test_python_2_is_understood_and_said_to_be_converted(arm: Path) -> None:
    older = WORKER.replace("        return 0.5\n", "        print 'here'\n        return 0.5\n")
    assert {"Arm_where", "Python 2 (converted when it is run)"} <= told(arm, older, Verdict.UNDERSTOOD).keys()


def test_keys_that_no_pdsl_declares_are_given_to_setParams(arm: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (arm / "arm.cdsl").write_text(CDSL.replace('params "arm.pdsl";', ""))
    assert rcgen([str(arm)]) == 0
    assert "    understood: Period.Compute, speed, spead\n" in capsys.readouterr().out


def test_proxies_of_topics_may_be_called_as_they_were_before_2018(arm: Path) -> None:
    assert "self.touch" in told(arm, WORKER.replace("touch_proxy", "touch"), Verdict.UNDERSTOOD)


def test_handlers_that_lack_are_named(arm: Path) -> None:
    assert told(arm, WORKER.replace("Arm_move", "Arm_mvoe"), Verdict.LACKING) == {
        "Arm_move": "nothing handles Arm.move; did you mean `Arm_mvoe`?"
    }


def test_handlers_that_cannot_be_called_are_named(arm: Path) -> None:
    for wrong in ("(self, joint)", "(self, joint, to, done)", "(self, joint, to, *, fast)"):
        text = WORKER.replace("(self, joint, to)", wrong)
        assert told(arm, text, Verdict.NOT_UNDERSTOOD) == {"Arm_move": "it does not take what it is given: joint, to"}
    for right in ("(self, *all)", "(self, joint, to, current=None)"):
        assert told(arm, WORKER.replace("(self, joint, to)", right), Verdict.NOT_UNDERSTOOD) == {}


def test_unknown_proxies_and_operations_are_named(arm: Path) -> None:
    text = WORKER.replace("self.hand_proxy.close()", "self.hnad_proxy.close(); self.touch_proxy.touhced(1)")
    assert told(arm, text, Verdict.NOT_UNDERSTOOD) == {
        "self.hnad_proxy": "the .cdsl has nothing that is called so; did you mean `hand_proxy`?",
        "self.touch_proxy.touhced": "`Touch` has no such operation; did you mean `touched`?",
    }
    assert told(arm, text, Verdict.WITHOUT_EFFECT) == {"self.hand_proxy": "requires Hand, and nothing here uses it"}


@pytest.mark.parametrize("called", ["ice_timeout(500).close()", "closeAsync()", "begin_close()", "ice_oneway()"])
def test_what_proxies_of_ice_have_is_understood(arm: Path, called: str) -> None:
    text = WORKER.replace("self.hand_proxy.close()", f"self.hand_proxy.{called}")
    assert told(arm, text, Verdict.NOT_UNDERSTOOD) == {}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("print 'hello'\ndef (:", "2to3 cannot convert it: Missing parentheses in call to 'print'"),
        ("class Other: pass\n", "there is no class SpecificWorker in it"),
        ("", "there is no class SpecificWorker in it"),
        ("\0", "not valid Python 3"),
    ],
)
def test_a_worker_that_cannot_be_read_is_said_to_be_so(arm: Path, text: str, said: str) -> None:
    [finding] = findings(arm, text)
    assert finding.verdict is Verdict.NOT_UNDERSTOOD
    assert said in finding.text


def test_what_is_the_same_of_several_things_is_said_once() -> None:
    same = [Finding("a", line, f"x{line}", Verdict.WITHOUT_EFFECT, "why") for line in (2, 1)]
    assert list(listed(same)) == ["  a", "    without effect: lines 1, 2: x1, x2: why"]
