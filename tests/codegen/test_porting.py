"""Components in C++: their files stay, a skeleton comes beside, and what is to be written in it is listed."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from robocomp_py.cli.rcgen import main as rcgen
from robocomp_py.codegen.porting import Kind, Porting, Task, listed, porting, sources

from .generated import linked, model_in, snapshot

CDSL = """\
import "Arm.idsl"; import "Hand.idsl";
Component arm
{
    Communications { implements Arm; requires Hand; publishes Touch; subscribesTo Stop; };
    language Cpp11;
    statemachine "arm.smdsl";
};
"""
ARM = """\
module RoboCompArm
{
    sequence<float> Angles;
    exception Stuck { string why; };
    interface Arm
    {
        float where(int joint);
        bool move(int joint, Angles to, out bool done, out string why) throws Stuck;
        void pose(out float x, out float y);
    };
    interface Stop { void halt(); };
    interface Touch { void touched(float force); };
};
"""
HAND = "module RoboCompHand { interface Hand { void close(); bool grip(float force, out float felt); }; };\n"
SMDSL = "m { initial_state rest; states work; transitions { rest => work; work => rest; }; };\n"
HEADER = """\
#include <genericworker.h>
#include <innermodel/innermodel.h>
#include <Eigen/Dense>
#include <QTimer>
#include <vector>
#include "gripper.h"
class SpecificWorker : public GenericWorker
{
    Q_OBJECT
public:
    SpecificWorker(TuplePrx tprx, bool startup_check);
    ~SpecificWorker();
    bool setParams(RoboCompCommonBehavior::ParameterList params);
    float Arm_where(const int joint);
    bool Arm_move(const int axis, const RoboCompArm::Angles &to, bool &done, std::string &why);
    void Arm_pose(float &x, float &y);
    void Stop_halt();
    void Leg_walk(int steps);
public slots:
    void compute();
    int startup_check();
    void initialize(int period);
    void sm_rest();
    void modify_node_slot(std::uint64_t id, const std::string &type){};
signals:
    void moved();
private:
    double clamp(double x) const { return x; }
    void split(const int x, int &high, int &low);
    void forgotten();
};
"""
BODIES = """\
#include "specificworker.h"
SpecificWorker::SpecificWorker(TuplePrx tprx, bool startup_check) : GenericWorker(tprx) {}
SpecificWorker::~SpecificWorker() {}
bool SpecificWorker::setParams(RoboCompCommonBehavior::ParameterList params) { return true; }
void SpecificWorker::initialize(int period) { timer.start(period); }
void SpecificWorker::compute()
{
    QMutexLocker lock(mutex);
    float felt;
    try { hand_proxy->grip(1.f, felt); hand_proxy->close(); touch_proxy->touched(felt); hand_proxy->clsoe(); }
    catch (const Ice::Exception &e) { std::cout << e; }
    laser_proxy->getLaserData();
    innermodel->update();
    emit moved();
}
int SpecificWorker::startup_check() { return 0; }
void SpecificWorker::sm_rest() {}
float SpecificWorker::Arm_where(const int joint) { return 0; }
bool SpecificWorker::Arm_move(const int axis, const RoboCompArm::Angles &to, bool &done, std::string &why)
{
    throw RoboCompArm::Stuck();
}
void SpecificWorker::Arm_pose(float &x, float &y) {}
void SpecificWorker::Leg_walk(int steps) {}
void SpecificWorker::split(const int x, int &high, int &low) {}
"""


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    """A component in C++ as RoboComp's users have it."""
    folder = tmp_path / "arm"
    model_in(folder, arm_cdsl=CDSL, Arm_idsl=ARM, Hand_idsl=HAND)
    (folder / "arm.smdsl").write_text(SMDSL)
    for name, text in (
        ("src/specificworker.h", HEADER),
        ("src/specificworker.cpp", BODIES),
        ("src/gripper.h", "class Gripper {};\n"),
        ("src/gripper.cpp", '#include "gripper.h"\n'),
        ("src/mainUI.ui", "<ui/>\n"),
        ("generated/genericworker.h", "// theirs\n"),
        ("etc/config", "Arm.Endpoints=tcp -p 10020\nHandProxy = hand:tcp -h localhost -p 10021\n"),
        ("CMakeLists.txt", "# theirs\n"),
        ("README.md", "# theirs\n"),
    ):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text)
    return folder


def of(arm: Path, bodies: str = BODIES, header: str = HEADER, worker: str = "") -> Porting:
    texts = {"src/specificworker.h": header, "src/specificworker.cpp": bodies, "src/gripper.h": ""}
    return porting(texts, worker, linked(arm / "arm.cdsl"))


def task(found: Porting, name: str) -> Task:
    [one] = [each for each in found.tasks if each.method.partition("(")[0].rpartition(" ")[2] == name]
    return one


# What is written.


@pytest.mark.parametrize("given", ["", "arm.cdsl"], ids=["the folder", "the model"])
def test_a_skeleton_comes_beside_and_their_files_keep_their_bytes(arm: Path, given: str) -> None:
    before = snapshot(arm)
    assert rcgen([str(arm / given)]) == 0
    after = snapshot(arm)
    assert before.items() <= after.items()
    new = {name.partition("/")[0] for name in after.keys() - before.keys()}
    assert new == {"generic", "specificworker.py", "__init__.py", "__main__.py", "tests"}
    assert rcgen(["--check", str(arm / given)]) == 0


def test_their_configuration_goes_on_to_count(arm: Path) -> None:
    assert rcgen([str(arm)]) == 0
    assert not (arm / "etc" / "config.toml").exists()
    (arm / "etc" / "config").unlink()
    assert rcgen([str(arm)]) == 0
    assert (arm / "etc" / "config.toml").is_file()


def test_the_skeleton_can_go_elsewhere(arm: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = snapshot(arm)
    assert rcgen([str(arm), "-o", str(tmp_path / "python")]) == 0
    assert snapshot(arm) == before
    assert "src/specificworker.cpp:18: float Arm_where(const int joint)" in capsys.readouterr().out
    assert (tmp_path / "python" / "specificworker.py").is_file()


# What becomes of each method.


def test_a_handler_goes_into_the_one_of_the_skeleton(arm: Path) -> None:
    found = task(of(arm), "Arm_where")
    assert (found.file, found.line, found.kind) == ("src/specificworker.cpp", 18, Kind.HANDLER)
    assert found.python == "def Arm_where(self, joint: int) -> float:"
    assert found.changes == ()


def test_a_long_signature_is_one_line(arm: Path) -> None:
    long = [f"int number_of_the_parameter_{each}" for each in range(8)]
    (arm / "Arm.idsl").write_text(ARM.replace("where(int joint)", f"where({', '.join(long)})"))
    python = task(of(arm), "Arm_where").python
    assert python.startswith("def Arm_where(self, number_of_the_parameter_0: int, ")
    assert python.endswith("number_of_the_parameter_7: int) -> float:")


def test_out_parameters_are_returned_behind_what_is_returned(arm: Path) -> None:
    found = task(of(arm), "Arm_move")
    assert found.python == "def Arm_move(self, joint: int, to: RoboCompArm.Angles) -> tuple[bool, bool, str]:"
    assert found.changes == (
        "done, why: out, so returned, behind what is returned already",
        "other names: axis is joint",
        "what it throws is raised: RoboCompArm.Stuck",
        "RoboCompArm.Angles is NDArray[np.float32]",
    )
    assert task(of(arm), "Arm_pose").changes == ("x, y: out, so returned, in this order",)


def test_each_type_in_cpp_is_given_the_one_in_python(arm: Path) -> None:
    assert task(of(arm), "Arm_move").types == (
        ("joint", "const int", "int"),
        ("to", "const RoboCompArm::Angles&", "NDArray[np.float32]"),
        ("", "bool", "bool"),
        ("done", "bool&", "bool"),
        ("why", "std::string&", "str"),
    )


def test_a_handler_with_other_parameters_than_the_idsl_is_told(arm: Path) -> None:
    found = task(of(arm, "float SpecificWorker::Arm_where() {}", header=""), "Arm_where")
    assert found.changes == ("the IDSL has other parameters now: float where(int joint)",)


def test_handlers_of_before_2018_are_known_without_their_interface(arm: Path) -> None:
    found = of(arm, "float SpecificWorker::where(int joint) {}\nvoid SpecificWorker::halt() {}", header="")
    assert task(found, "where").python.startswith("def Arm_where(")
    assert task(found, "halt").python == "def Stop_halt(self) -> None:"


def test_what_the_component_does_around_its_handlers_has_its_hook(arm: Path) -> None:
    found = of(arm)
    hooks = {name: task(found, name).python for name in ("SpecificWorker", "setParams", "compute", "~SpecificWorker")}
    assert hooks == {
        "SpecificWorker": "def initialize(self) -> None:",
        "setParams": "def initialize(self) -> None:",
        "compute": "def compute(self) -> None:",
        "~SpecificWorker": "def finish(self) -> None:",
    }
    assert task(found, "sm_rest").kind is Kind.STATE


def test_the_state_machine_of_every_component_is_its_life_cycle(arm: Path) -> None:
    found = of(arm, "void SpecificWorker::sm_finalize() {}", header="")
    assert (task(found, "sm_finalize").kind, task(found, "sm_finalize").python) == (
        Kind.LIFE,
        "def finish(self) -> None:",
    )


def test_helpers_stay_methods_and_give_back_what_they_change(arm: Path) -> None:
    found = of(arm)
    assert (task(found, "clamp").kind, task(found, "clamp").file) == (Kind.HELPER, "src/specificworker.h")
    assert task(found, "split").changes == ("gives high, low back: return them",)
    assert task(found, "forgotten").changes == ("declared, and defined nowhere",)
    assert task(found, "Leg_walk").changes == ("is it a handler? the .cdsl has no Leg that is received",)
    older = of(arm, "void SpecificWorker::Arm_wave(std::vector<int> &how) {}", header="")
    assert task(older, "Arm_wave").changes == (
        "is it a handler? Arm has no wave here",
        "gives how back: return it",
    )


def test_what_has_no_counterpart_is_no_work(arm: Path) -> None:
    found = of(arm)
    kinds = {name: task(found, name).kind for name in ("moved", "modify_node_slot", "startup_check")}
    assert kinds == {"moved": Kind.LACKING, "modify_node_slot": Kind.LACKING, "startup_check": Kind.GONE}
    assert not {each.method for each in found.left} & {"void moved()", "int startup_check()"}


def test_handlers_that_cpp_does_not_have_are_named(arm: Path) -> None:
    assert of(arm).new == ()
    assert task(of(arm), "Stop_halt").changes == ("declared, and defined nowhere",)
    assert of(arm, "float SpecificWorker::Arm_where(int joint) {}", header="").new == (
        "Arm_move",
        "Arm_pose",
        "Stop_halt",
    )


# What is written already.


def test_a_method_is_to_do_until_its_python_does_more_than_the_skeleton(arm: Path) -> None:
    assert rcgen([str(arm)]) == 0
    path = arm / "specificworker.py"
    skeleton = path.read_text()
    assert not [each for each in of(arm, worker=skeleton).tasks if each.written]
    text = skeleton.replace("return 0.0\n", "return 1.5\n", 1) + "\n    def clamp(self, x):\n        return x\n"
    assert text != skeleton
    done = of(arm, worker=text)
    assert {each.method for each in done.tasks if each.written} == {
        "float Arm_where(const int joint)",
        "double clamp(double x)",
    }
    said = "\n".join(listed(done, arm))
    assert "handlers written: Arm_where" in said
    assert "Arm_where(const int joint)" not in said


def test_a_specific_part_that_is_no_python_has_nothing_written(arm: Path) -> None:
    assert not [each for each in of(arm, worker="def (").tasks if each.written]


# What else is in its code.


def said(found: Porting) -> dict[str, tuple[int, str]]:
    return {each.what: (each.line, each.text) for each in found.others}


def test_libraries_are_told_with_what_does_the_same(arm: Path) -> None:
    others = said(of(arm))
    assert others["Eigen/Dense"] == (3, "numpy does this")
    assert others["innermodel/innermodel.h"][1].startswith("InnerModel's tree of transforms is not known here")
    assert others["gripper.h"] == (1, "code of your own: to be ported too")
    assert not {"vector", "genericworker.h", "specificworker.h"} & others.keys()


def test_what_is_said_another_way_is_told_where_it_is(arm: Path) -> None:
    others = said(of(arm))
    assert others["Ice::Exception"] == (11, "except RobocompError, of robocomp_py.errors")
    assert others["QMutexLocker"][0] == 8
    assert others["timer.start"] == (5, "the period is self.period, in seconds")
    assert others["emit"] == (14, "a signal of Qt: call what is connected to it")


def test_calls_of_others_that_give_something_back_are_spelled(arm: Path) -> None:
    others = said(of(arm))
    assert others["hand_proxy->grip"] == (10, "ret, felt = self.hand_proxy.grip(force)")
    assert not {"hand_proxy->close", "touch_proxy->touched"} & others.keys()


def test_calls_that_the_model_does_not_know_are_told(arm: Path) -> None:
    others = said(of(arm))
    assert others["hand_proxy->clsoe"] == (10, "`Hand` has no such operation; did you mean `close`?")
    assert others["laser_proxy->getLaserData"] == (12, "the .cdsl has nothing that is called so")


def test_what_a_generator_wrote_is_nobody_s_to_port() -> None:
    names = ["main.cpp", "armI.h", "specificmonitor.cpp", "gripper.cpp", "specificworker.cpp", "ui_mainUI.h", "a.txt"]
    assert sources(names) == ["specificworker.cpp", "gripper.cpp"]


# For people and machines.


def test_the_list_is_printed(arm: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert rcgen([str(arm)]) == 0
    out = capsys.readouterr().out
    assert "are written.\n\n  handlers\n    src/specificworker.cpp:18: float Arm_where(const int joint)\n" in out
    assert "        def Arm_where(self, joint: int) -> float:\n" in out
    assert "    src/specificworker.h:2: innermodel/innermodel.h: " in out


def test_what_is_no_file_and_no_text_is_stepped_over(arm: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (arm / "src" / "models.h").mkdir()
    (arm / "src" / "gone.cpp").symlink_to("nowhere.cpp")
    (arm / "src" / "old.cpp").write_bytes(b"// caf\xe9\n/* \x00 */ void SpecificWorker::brew() {}\n")
    assert rcgen([str(arm)]) == 0
    assert "src/old.cpp:2: void brew()\n" in capsys.readouterr().out


def test_the_list_can_be_had_as_json(arm: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert rcgen(["--json", str(arm)]) == 0
    told = json.loads(capsys.readouterr().out)["porting"]
    where = next(each for each in told["methods"] if each["python"].startswith("def Arm_where"))
    assert (where["kind"], where["line"], where["written"]) == ("handlers", 18, False)
    assert {each["verdict"] for each in told["others"]} == {"understood", "lacking", "not understood"}
