"""Components of RoboComp's own generators run as they are, whenever they were made."""

from __future__ import annotations

import logging
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robocomp_py.deploy.uses import node_of
from robocomp_py.dsl.workspace import Workspace
from robocomp_py.errors import ComponentError, RemoteFailure, Unreachable
from robocomp_py.runtime.commandline import parser_of, prepare
from robocomp_py.runtime.load import load_worker
from robocomp_py.runtime.together import Together
from robocomp_py.testing.components import ComponentTest
from robocomp_py.testing.patience import SOON, wait_until

from .components import ASKER, BARE, CLIENT, FORMS, OF_2021, OF_2025, SERVER, THEIRS, Form, digests, made


@pytest.fixture(scope="module")
def arms(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A server of each generation."""
    root = tmp_path_factory.mktemp("arms")
    return {year: made(root / year / "arm", form) for year, form in FORMS.items()}


@pytest.fixture(scope="module")
def asker(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made(tmp_path_factory.mktemp("asker") / "asker", ASKER)


def user_of(test: ComponentTest) -> Any:
    """The object that the component's author has written the class of."""
    return test.worker._user


def running(folder: Path, *arguments: str, alone: bool = False, **fakes: Any) -> ComponentTest:
    """A component with the configuration in its folder."""
    worker = load_worker(folder, afresh=True, alone=alone)
    _, document = prepare(worker, parser_of(worker.component).parse_args(list(arguments)))
    return ComponentTest(worker, document, **fakes)


def server(folder: Path, code: str, **instead: str) -> Path:
    """A component that implements Arm, of today's form, with some methods."""
    return made(folder / "arm", Form(SERVER, BARE + code), **instead)


def client(folder: Path, code: str) -> Path:
    """A component that requires Arm, with `compute` as given."""
    return made(folder / "asker", Form(CLIENT, BARE.replace("        pass\n", code)))


# Every generation.


@pytest.mark.parametrize("year", FORMS)
def test_a_component_of_each_generation_starts_computes_and_answers(arms: dict[str, Path], year: str) -> None:
    before = digests(arms[year])
    with running(arms[year]) as arm:
        arm.wait_for(lambda: arm.received("touch.touched"))
        forces, number = arm.received("touch.touched")[0]
        assert list(forces) == [1.5, 1.5]
        assert number >= 1
        joints = arm.call("Arm.joints", 3)
        assert [joint.name for joint in joints] == ["0", "1", "2"]
        assert list(joints[2].past) == [2, 2]
        fits, mode, path = arm.call("Arm.move", "etc/model.xml", 2.5)
        assert (fits, int(mode), list(path)) == (True, 1, [2.5])
        where = arm.call("Arm.where", b"abc", {"left": [1.0, 0.5]})
        assert (where.x, where.y) == (3.0, 1.5)
        with pytest.raises(Exception, match="negative") as caught:
            arm.call("Arm.joints", -1)
        assert type(caught.value).__name__ == "Stuck"
        assert arm.call("Arm.halt") is None
        assert not user_of(arm).timer.isActive()
    assert arm.fine
    assert digests(arms[year]) == before


@pytest.mark.parametrize(("middleware", "year"), [("inproc", "2016"), ("shm", "2021"), ("zeromq", "2025")])
def test_two_of_them_meet_over_any_middleware(
    arms: dict[str, Path], asker: Path, middleware: str, year: str, tmp_path: Path
) -> None:
    options = ["--middleware", middleware, "--set", f'namespace="{tmp_path.name}"']
    with together([arms[year], *options], [asker, *options]) as (arm, asking):
        seen = asking._user.seen
        wait_until(lambda: {type(each) for each in seen} == {tuple, list}, what="it was answered, and has heard")
        answer = next(each for each in seen if type(each) is tuple)
        assert (answer[0], answer[1].name, answer[2]) == (True, "moving", [2.0])
        assert [1.5, 1.5] in seen
        assert arm._user.number > 0


def test_the_marker_ice_does_not_choose_a_middleware(tmp_path: Path) -> None:
    marked = SERVER.replace("implements Arm;", "implements Arm(ice);").replace("Touch;", "Touch(ice);")
    folder = made(tmp_path / "arm", Form(marked, BARE))
    worker = load_worker(folder, afresh=True)
    settings, _ = prepare(worker, parser_of(worker.component).parse_args(["--middleware", "zeromq"]))
    assert [settings.port(port, "").middleware for port in worker.component.ports] == ["zeromq", "zeromq"]
    instances = 'Component arm { }; Component old : arm { existing "true"; port 9; };'
    text = f'import "arm/arm.cdsl"; Deployment net {{ {instances} }};'
    (tmp_path / "net.ddsl").write_text(text)
    workspace = Workspace()
    linked = workspace.component(folder / "arm.cdsl")
    model = workspace.deployment(tmp_path / "net.ddsl")
    assert linked
    assert model
    nodes = [node_of(model, each, linked) for each in model.instances]
    assert [[port.middleware for port in each.component.ports] for each in nodes] == [[None] * 2, ["ice"] * 2]


@contextmanager
def together(*commands: list[Any]) -> Iterator[list[Any]]:
    """Several components in this process; their workers, once they are ready."""
    process = Together(lambda text: None)
    members = []
    for folder, *arguments in commands:
        worker = load_worker(folder, afresh=True)
        settings, _ = prepare(worker, parser_of(worker.component).parse_args(arguments))
        members.append(process.add(worker, settings))
    thread = threading.Thread(target=process.run)
    thread.start()
    try:
        wait_until(lambda: all(each.running.is_up for each in members), what="they are ready")
        yield [each.running.worker for each in members]
    finally:
        process.stop()
        thread.join(SOON)
        assert not thread.is_alive()


# Its modules.


def test_two_in_one_process_have_modules_of_their_own(tmp_path: Path) -> None:
    code = """
    def Arm_joints(self, number):
        import utils, interfaces
        return [interfaces.RoboCompArm.Joint(name=utils.NAME)]
"""
    folders = [server(tmp_path / name, code, **{"src/utils.py": f"NAME = '{name}'\n"}) for name in ("left", "right")]
    tests = [running(folder) for folder in folders]
    with tests[0] as left, tests[1] as right:
        assert [each.call("Arm.joints", 0)[0].name for each in (left, right)] == ["left", "right"]
        types = [type(each.worker._user) for each in (left, right)]
        assert types[0].__mro__[1] is not types[1].__mro__[1]


def test_names_of_their_own_count_more_than_those_that_come_by_a_star(tmp_path: Path) -> None:
    folder = made(tmp_path / "arm", FORMS["2019"], **{"src/lib.py": "class Joint:\n    own = True\n"})
    worker = folder / "src" / "specificworker.py"
    text = "from lib import Joint\n" + worker.read_text()
    worker.write_text(text.replace("def Arm_halt(self):", "def Arm_halt(self):\n        assert Joint.own and Frame"))
    with running(folder) as arm:
        arm.call("Arm.halt")


def test_a_second_instance_shares_no_variables_with_the_first(tmp_path: Path) -> None:
    code = """
    def Arm_halt(self):
        STATE.append(self)

    def Arm_joints(self, number):
        return [ifaces.RoboCompArm.Joint()] * len(STATE)

STATE = []
"""
    worker = load_worker(server(tmp_path, code))
    with ComponentTest(worker) as one, ComponentTest(worker) as other:
        one.call("Arm.halt")
        assert (len(one.call("Arm.joints", 0)), len(other.call("Arm.joints", 0))) == (1, 0)


def test_files_import_each_other_by_whatever_name_their_generation_uses(tmp_path: Path) -> None:
    code = """
    def Arm_joints(self, number):
        import parts.deep.leaf, parts.deep as deep
        from parts.deep import leaf
        from parts import wing
        from src.parts.wing import NAME
        from root import NAME as ROOT
        from nested.inner.tool import NAME as TOOL
        assert parts.deep.leaf is leaf is deep.leaf and wing.leaf is leaf
        return [ifaces.RoboCompArm.Joint(name=NAME + ROOT + TOOL)]
"""
    more = {
        "src/parts/deep/leaf.py": "import interfaces\nNAME = 'leaf'\n",
        "src/parts/wing.py": "from .deep import leaf\nfrom .deep.leaf import NAME\n",
        "src/nested/inner/tool.py": "NAME = 'tool'\n",
        "root.py": "from dataclasses import dataclass\n@dataclass\nclass A:\n    a: 'int' = 1\nNAME = 'root'\n",
    }
    with running(server(tmp_path, code, **more)) as arm:
        assert arm.call("Arm.joints", 0)[0].name == "leafroottool"


@pytest.mark.parametrize(
    "line",
    [
        "from learnbot_components.laser.src.genericworker import *",
        "from learnbot_dsl.components.laser.src.genericworker import *",
        "from src.genericworker import *",
        "from .genericworker import *",
    ],
)
def test_the_generic_part_is_the_components_own_by_each_of_its_names(tmp_path: Path, line: str) -> None:
    code = f"""\
{line}
from learnbot_components.arm.src.helper import VALUE
import learnbot_components.arm.src.helper as helper
import learnbot_components.arm.src.helper

class SpecificWorker(GenericWorker):
    def __init__(self, proxy_map):
        super(SpecificWorker, self).__init__(proxy_map)
        self.seen = [VALUE, helper.VALUE, learnbot_components.arm.src.helper.VALUE]
"""
    more = {"src/helper.py": "VALUE = 7\n", "src/genericworker.py": THEIRS}
    folder = made(tmp_path / "arm", Form(SERVER, code, more=more))
    with running(folder) as arm:
        arm.wait_for(lambda: user_of(arm) is not None)
        assert user_of(arm).seen == [7, 7, 7]
    assert arm.fine


def test_the_generic_part_replaces_no_names_that_robocomps_does_not_have(tmp_path: Path) -> None:
    code = """
    def Arm_joints(self, number):
        assert time() > 0 and copy("a") == "a"
        return [ifaces.RoboCompArm.Joint(name=f"{traceback} {Path} {subprocess}")]
"""
    folder = server(tmp_path, code)
    file = folder / "src" / "specificworker.py"
    head = "from time import time\nfrom copy import copy\ntraceback, Path, subprocess = 1, 2, 3\n"
    file.write_text(head + file.read_text())
    with running(folder) as arm:
        assert arm.call("Arm.joints", 0)[0].name == "1 2 3"


def test_futures_are_imported_in_all_forms(tmp_path: Path) -> None:
    code = """
    def Arm_joints(self, number):
        import concurrent.futures, concurrent.futures.process
        from concurrent import futures
        from concurrent.futures import ThreadPoolExecutor
        assert futures is concurrent.futures
        with ThreadPoolExecutor(1) as pool:
            kinds = pool.map(lambda each: each.__name__, [concurrent.futures.process.BrokenProcessPool])
        return [ifaces.RoboCompArm.Joint(name=each) for each in kinds]
"""
    with running(server(tmp_path, code)) as arm:
        assert [each.name for each in arm.call("Arm.joints", 0)] == ["BrokenProcessPool"]


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("import cv2xyz", "imports `cv2xyz`, which is not installed here; try: pip install cv2xyz"),
        ("raise ModuleNotFoundError(name='tkinter')", "imports `tkinter`, which is not installed here; try: apt-get"),
        ("raise ModuleNotFoundError(name='google.protobuf')", "try: pip install protobuf"),
        ("import os, google.protobuf.message as message", "try: pip install protobuf"),
        ("from google import protobuf", "try: pip install protobuf"),
        ("raise ModuleNotFoundError(name='Ice')", "try: pip install 'robocomp-py[ice]'"),
        ("import mutex", "imports `mutex` of Python 2; in Python 3, use `threading.Lock`"),
        ("import RoboCompHand", "imports `RoboCompHand`, which no .idsl that its .cdsl imports defines"),
        ("import librobocomp_qmat", "imports `librobocomp_qmat`, a library of RoboComp's own"),
        ("import src.absent", "imports `src.absent`, which is not there in "),
    ],
)
def test_a_library_that_is_missing_is_named_with_what_to_do(tmp_path: Path, line: str, told: str) -> None:
    folder = server(tmp_path, "", **{"src/needs.py": f"# needs\n{line}\n"})
    (folder / "src" / "specificworker.py").write_text("import needs\n" + BARE)
    with pytest.raises(ComponentError, match=r"src/needs\.py:2: ") as caught:
        running(folder)
    assert told in str(caught.value)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("class Other: pass\n", "has no class SpecificWorker"),
        ("class SpecificWorker: pass\n", "has no class SpecificWorker(GenericWorker)"),
        ("def broken(:\n", "specificworker.py:1: not valid Python 3, and 2to3 cannot convert it"),
        ("from genericworker import *\n1 / 0\nclass SpecificWorker: pass\n", "specificworker.py"),
        (BARE.replace("startup_check=False", "fullscreen"), "give `fullscreen` a default"),
    ],
)
def test_a_file_that_is_no_component_says_why(tmp_path: Path, text: str, told: str) -> None:
    folder = server(tmp_path, "")
    (folder / "src" / "specificworker.py").write_text(text)
    with pytest.raises(ComponentError) as caught, ComponentTest(load_worker(folder)):
        pass
    assert told in str(caught.value)


def test_an_unreadable_file_fails_only_the_code_that_imports_it(tmp_path: Path) -> None:
    code = "\n    def Arm_joints(self, number):\n        import left_over\n"
    folder = server(tmp_path, code, **{"src/left_over.py": "def broken(:\n"})
    (folder / "src" / "folder.py").mkdir()
    with running(folder) as arm, pytest.raises(RemoteFailure, match="invalid syntax"):
        arm.call("Arm.joints", 0)
    worker = folder / "src" / "specificworker.py"
    worker.write_text(f"import left_over\n{worker.read_text()}")
    with pytest.raises(ComponentError, match=r"left_over\.py:1: not valid Python 3"):
        running(folder)


# What calls and is called.


def test_an_exception_of_user_code_is_logged_with_its_place_and_the_component_continues(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    code = """
        self.seen.append(1)
        if len(self.seen) < 3:
            raise ValueError("not yet")
"""
    folder = client(tmp_path, code)
    with running(folder, arm={}) as asker:
        asker.wait_for(lambda: len(user_of(asker).seen) > 3)
    assert asker.fine
    [told] = [each.getMessage() for each in caplog.records if each.levelno >= logging.ERROR]
    assert told.startswith("SpecificWorker.compute raised ValueError\n")
    assert f'File "{folder}/src/specificworker.py", line 20' in told
    assert "robocomp_py" not in told


def test_errors_of_ours_are_exceptions_of_ice(tmp_path: Path) -> None:
    code = """
        for name in (-1, -2, 1):
            try:
                self.seen.append(self.arm_proxy.joints(name))
            except RoboCompArm.Stuck as e:
                self.seen.append(("stuck", e.what, e.joint, isinstance(e, Ice.UserException)))
            except Ice.Exception as e:
                self.seen.append((type(e).__name__, isinstance(e, Ice.UnknownException), str(e)))
        self.timer.stop()
"""
    folder = client(tmp_path, code)

    def joints(number: int) -> Any:
        if number == -1:
            stuck = worker.component.ports[0].interface.operations[0].raises[0].python
            assert stuck is not None
            raise stuck("no way", 7)
        if number == -2:
            raise ZeroDivisionError("divided")
        return []

    worker = load_worker(folder)
    with ComponentTest(worker, arm={"joints": joints}) as asker:
        asker.wait_for(lambda: len(user_of(asker).seen) == 3)
        stuck, failed, fine = user_of(asker).seen
    assert stuck == ("stuck", "no way", 7, True)
    assert failed[:2] == ("RemoteFailure", True)
    assert "ZeroDivisionError: divided" in failed[2]
    assert fine == []


def test_a_peer_that_is_gone_refuses_connections(arms: dict[str, Path], tmp_path: Path) -> None:
    code = """
        try:
            self.arm_proxy.halt()
        except Ice.ConnectionRefusedException as e:
            self.seen.append(e)
"""
    options = ["--middleware", "inproc"]
    with together([arms["2021"], *options], [client(tmp_path, code), *options]) as (arm, asking):
        arm.stop()
        wait_until(lambda: asking._user.seen, what="it is refused")
        assert isinstance(asking._user.seen[0], Unreachable)


def test_a_missing_method_is_reported_at_the_start_and_fails_when_called(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = server(tmp_path, "\n    def Arm_halt(self):\n        pass\n")
    with running(folder) as arm, pytest.raises(RemoteFailure, match=r"no method Arm_move, so that Arm\.move is not"):
        arm.call("Arm.move", "a", 1.0)
    assert any("has no method Arm_joints; calls of it fail" in each.getMessage() for each in caplog.records)


def test_proxies_take_arguments_as_ice_does(tmp_path: Path) -> None:
    code = """
        picture = np.zeros((2, 3), np.uint8)
        self.seen += [
            self.arm_proxy.where(picture, {"left": np.float64(1) * np.ones(2)}),
            self.arm_proxy.where(paths=None, picture=None),
            self.arm_proxy.where(b"12", {}, {"a": "context"}),
            self.arm_proxy.whereAsync(bytearray(3), {}).result(),
            self.arm_proxy.ice_timeout(500).where([1, 2, 3], RoboCompArm.Paths()),
        ]
        for wrong in ((), (1, 2, 3, 4)):
            try:
                self.arm_proxy.where(*wrong)
            except TypeError as e:
                self.seen.append(str(e))
        self.timer.stop()
"""
    folder = client(tmp_path, code)
    worker = folder / "src" / "specificworker.py"
    worker.write_text("import numpy as np\n" + worker.read_text())
    with running(folder) as asker:
        asker.wait_for(lambda: len(user_of(asker).seen) == 7)
        assert [each.x for each in user_of(asker).seen[:5]] == [0.0] * 5
        assert user_of(asker).seen[5] == "where takes picture, paths, and was given 0"
        given = [(bytes(picture), dict(paths)) for picture, paths in asker.received("arm.where")]
    assert given[1:] == [(b"", {}), (b"12", {}), (b"\0\0\0", {}), (b"\1\2\3", {})]
    assert (given[0][0], list(given[0][1]["left"])) == (bytes(6), [1.0, 1.0])


def test_what_is_received_are_lists_and_bytes(tmp_path: Path) -> None:
    code = """
    def Arm_where(self, picture, paths):
        self.seen += [picture, paths]
        return ifaces.RoboCompFrame.Frame()

    def Arm_move(self, name, to):
        return True, 1, None
"""
    with running(server(tmp_path, code)) as arm:
        arm.call("Arm.where", np.arange(3, dtype=np.uint8), {"left": np.ones(2, np.float32)})
        assert user_of(arm).seen == [b"\0\1\2", {"left": [1.0, 1.0]}]
        assert len(arm.call("Arm.move", "", 0.0)[2]) == 0


@pytest.mark.parametrize("lock", ["QtCore.QMutex()", "threading.Lock()", "threading.RLock()", "queue.Queue()"])
def test_a_handler_that_waits_for_a_compute_which_waits_is_no_deadlock(tmp_path: Path, lock: str) -> None:
    """A lock is held around a call, and the one who is called calls back into a handler that wants the lock."""
    taken, released = ("self.lock.lock()", "self.lock.unlock()")
    if "threading" in lock:
        taken, released = "self.lock.acquire()", "self.lock.release()"
    if "queue" in lock:
        taken, released = "pass", "self.lock.put(1)"
    code = f"""
    def setParams(self, params):
        self.lock = {lock}
        self.inside = threading.Event()

    def Arm_halt(self):
        self.inside.set()
        {taken if "queue" not in lock else "self.lock.get()"}
        {released if "queue" not in lock else "pass"}

    @QtCore.Slot()
    def compute(self):
        {taken}
        self.inside.wait(20)
        time.sleep(0)
        {released}
        self.seen.append(self.inside.is_set())
"""
    folder = server(tmp_path, code)
    worker = folder / "src" / "specificworker.py"
    worker.write_text("import queue, threading\nimport time\n" + worker.read_text())
    with running(folder) as arm:
        arm.call("Arm.halt")
        arm.wait_for(lambda: True in user_of(arm).seen)
    assert arm.fine


def test_a_loop_over_a_queue_that_is_never_empty_lets_handlers_run(tmp_path: Path) -> None:
    code = """
    over = False

    def Arm_halt(self):
        self.over = True

    @QtCore.Slot()
    def compute(self):
        things = queue.Queue()
        end = time.monotonic() + 20
        while not self.over and time.monotonic() < end:
            things.put(1)
            self.seen.append(things.get())
"""
    folder = server(tmp_path, code)
    worker = folder / "src" / "specificworker.py"
    worker.write_text("import queue\nimport time\n" + worker.read_text())
    with running(folder) as arm:
        arm.wait_for(lambda: user_of(arm).seen)
        arm.call("Arm.halt")
    assert arm.fine


def test_the_period_can_be_changed_from_inside_and_from_outside(tmp_path: Path) -> None:
    with running(server(tmp_path, "\n    def Arm_halt(self):\n        self.setPeriod(40)\n")) as arm:
        arm.call("Arm.halt")
        assert user_of(arm).Period == 40
        arm.worker.period = 0.02
        arm.wait_for(lambda: user_of(arm).Period == 20 and user_of(arm).timer.isActive())


def test_killYourSelf_ends_the_component(tmp_path: Path) -> None:
    code = """
    def Arm_halt(self):
        self.kill.connect(lambda: self.seen.append("killed"))
        self.killYourSelf()
"""
    with running(server(tmp_path, code)) as arm:
        seen = user_of(arm).seen
        arm.call("Arm.halt")
        wait_until(lambda: arm._running.is_over, what="it has ended")
    assert arm.fine
    assert seen == ["killed"]


@contextmanager
def what_goes_on(tmp_path: Path, code: str, caplog: pytest.LogCaptureFixture, *, grace_s: float) -> Iterator[str]:
    """The names of the threads that a component has begun, and that wait for OVER, as long as this is entered.

    Who does not wait for OVER has `grace_s` to end, and so long this takes.
    """
    folder = server(tmp_path, "")
    worker = folder / "src" / "specificworker.py"
    head = "import threading\nfrom concurrent import futures\n"
    worker.write_text(f"{head}{worker.read_text()}{code}\nOVER = threading.Event()\n")
    with running(folder) as arm:
        arm.worker._grace_s = arm.worker._work_s = grace_s
        over = vars(arm.worker._imports.load("specificworker"))["OVER"]
    assert arm.fine
    try:
        [told] = [each.getMessage() for each in caplog.records if "its own threads are" in each.getMessage()]
        yield told.rpartition(": ")[2]
    finally:
        over.set()


def test_threads_of_theirs_are_waited_for_and_do_not_keep_the_process(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    code = """
    def setParams(self, params):
        ended = self.ended = threading.Event()
        threading.Thread(target=ended.wait, name="brief").start()
        threading.Thread(target=self.forever, name="endless").start()

    def __del__(self):
        self.ended.set()

    @staticmethod
    def forever():
        OVER.wait()
"""
    with what_goes_on(tmp_path, code, caplog, grace_s=0.3 * SOON) as names:
        assert names == "endless"


def test_what_pools_of_theirs_do_does_not_keep_the_process(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    code = """
    def setParams(self, params):
        self.pool = futures.ThreadPoolExecutor(1, "endless")
        self.pool.submit(OVER.wait)
        futures.ThreadPoolExecutor(1, "idle").submit(int)
"""
    with what_goes_on(tmp_path, code, caplog, grace_s=0.3 * SOON) as names:
        assert names == "endless_0"
        assert [each.daemon for each in threading.enumerate() if each.name == names] == [True]


def test_the_end_waits_for_what_its_pools_were_given_and_not_for_their_idle_threads(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    code = """
    def setParams(self, params):
        self.pool = futures.ThreadPoolExecutor(1)
        for number in range(20):
            self.pool.submit(save, number)

def save(number):
    time.sleep(0.02)
    SAVED.append(number)

SAVED, IDLE = [], futures.ThreadPoolExecutor(2)
IDLE.submit(int)
"""
    folder = server(tmp_path, "")
    worker = folder / "src" / "specificworker.py"
    worker.write_text(f"import time\nfrom concurrent import futures\n{worker.read_text()}{code}")
    with running(folder) as arm:
        arm.worker._grace_s = arm.worker._work_s = 10 * SOON
        saved = vars(arm.worker._imports.load("specificworker"))["SAVED"]
    assert arm.fine
    assert saved == list(range(20))
    assert not [each for each in caplog.records if "its own threads" in each.getMessage()]


def test_waiting_for_a_pool_at_the_end_has_no_time_limit(tmp_path: Path) -> None:
    code = """
    def setParams(self, params):
        pool = futures.ThreadPoolExecutor(1)
        for number in range(10):
            pool.submit(save, number)
        QtCore.QCoreApplication.instance().aboutToQuit.connect(pool.shutdown)

def save(number):
    time.sleep(0.02)
    SAVED.append(number)

SAVED = []
"""
    folder = server(tmp_path, "")
    worker = folder / "src" / "specificworker.py"
    worker.write_text(f"import time\nfrom concurrent import futures\n{worker.read_text()}{code}")
    with running(folder) as arm:
        arm.worker._grace_s = arm.worker._work_s = 0.0
        saved = vars(arm.worker._imports.load("specificworker"))["SAVED"]
    assert saved == list(range(10))


def test_calls_that_its_pools_do_not_get_to_are_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    code = """
    def setParams(self, params):
        self.pool = futures.ThreadPoolExecutor(1, "endless")
        self.pool.submit(go_on)
        BEGUN.wait()
        for _ in range(2):
            self.pool.submit(go_on)

def go_on():
    BEGUN.set()
    OVER.wait()

BEGUN = threading.Event()
"""
    with what_goes_on(tmp_path, code, caplog, grace_s=0.2) as names:
        assert names == "endless_0"
    assert any("2 calls in its thread pools have not begun after 0.2 s" in each for each in caplog.messages)


# What it is configured with.


def test_parameters_are_texts_of_every_key(arms: dict[str, Path], tmp_path: Path) -> None:
    code = "\n    def setParams(self, params):\n        self.seen.append(params)\n"
    folder = server(tmp_path, code, config=OF_2021.files["etc/config"])
    with running(folder, "--set", "params.width=800", "--set", "params.depth=true") as arm:
        [params] = user_of(arm).seen
    assert params == {
        "Arm.Endpoints": "tcp -p 10020",
        "TouchTopic.Endpoints": "tcp",
        "Ice.Warn.Connections": "0",
        "InnerModelPath": "etc/model.xml",
        "fast": "true",
        "width": "800",
        "Robot.Name": "left arm",
        "depth": "true",
    }


def test_a_users_own_toml_file_does_not_hide_the_configuration(tmp_path: Path) -> None:
    code = "\n    def setParams(self, params):\n        self.seen.append(params)\n"
    more = {"etc/config.toml": '[directories]\nmodels = "models"\n'}
    folder = server(tmp_path, code, config=OF_2021.files["etc/config"], **more)
    with running(folder) as arm:
        assert user_of(arm).seen[0]["width"] == "640"


def test_since_2025_they_are_tables_of_values(tmp_path: Path) -> None:
    text = OF_2025.files["src/specificworker.py"].replace("self.number = 0", "self.seen = configData")
    folder = made(tmp_path / "arm", OF_2025, worker=text)
    with running(folder, "--set", "component.period=0.5") as arm:
        given = user_of(arm).seen
    assert given["Period"] == {"Compute": 500, "Emergency": 500}
    assert (given["fast"], given["width"], given["Ice"]) == (True, 640, {"Warn": {"Connections": 0}})


def test_for_a_misspelt_parameter_the_one_that_was_meant_is_proposed(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    code = "\n    def setParams(self, params):\n        self.seen.append(params['widht'])\n"
    folder = server(tmp_path, code, config=OF_2021.files["etc/config"])
    with running(folder):
        pass
    assert "unknown parameter `widht`; did you mean `width`?" in caplog.text


def test_it_runs_in_its_own_folder_if_it_has_the_process_for_itself(
    arms: dict[str, Path], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    for alone in (False, True):
        with running(arms["2021"], alone=alone):
            assert (Path.cwd() == arms["2021"]) == alone
