"""Components in the form in which RoboComp's generators have left them in their users' hands, year by year."""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Mapping
from pathlib import Path

from robocomp_py.cli.rcgen import main as rcgen

IDSL = {
    "Arm.idsl": """\
import "Frame.idsl";
module RoboCompArm
{
    exception Stuck { string what; int joint = 1; };
    enum Mode { idle, moving, print };
    sequence<byte> Picture;
    sequence<float> Path;
    dictionary<string, Path> Paths;
    struct Joint { string name; float angle; Picture picture; Path past; Mode mode; bool on; int lambda; };
    sequence<Joint> Joints;
    interface Arm
    {
        Joints joints(int number) throws Stuck;
        bool move(string name, float to, out Mode mode, out Path path);
        RoboCompFrame::Frame where(Picture picture, Paths paths);
        void halt();
    };
};
""",
    "Frame.idsl": """\
module RoboCompFrame { struct Frame { float x; float y; }; sequence<Frame> Frames; };
""",
    "Touch.idsl": """\
import "Arm.idsl";
module RoboCompTouch
{
    interface Touch { void touched(RoboCompArm::Path forces, int number); };
};
""",
}


class Form:
    """One generation: its CDSL, its files, and where its configuration is."""

    def __init__(self, cdsl: str, worker: str, config: str = "", more: Mapping[str, str] | None = None) -> None:
        self.files = {"arm.cdsl": cdsl, "src/specificworker.py": worker, **IDSL, **(more or {})}
        if config:
            self.files["etc/config"] = config


SERVER = """\
import "Arm.idsl"; import "Touch.idsl";
Component arm
{
    Communications { implements Arm; publishes Touch; };
    language python;
};
"""
CLIENT = """\
import "Arm.idsl"; import "Touch.idsl";
Component asker
{
    Communications { requires Arm; subscribesTo Touch; };
    language python;
};
"""
CONFIG = """\
# Endpoints for implemented interfaces
Arm.Endpoints=tcp -p 10020
TouchTopic.Endpoints=tcp
Ice.Warn.Connections=0
InnerModelPath = etc/model.xml   # a comment
fast = true
width=640
Robot.Name = "left arm"
"""
# What a generator of RoboComp has left in `src`, which must not be loaded: it needs Ice, and its files.
THEIRS = """\
import Ice
raise RuntimeError("this is the generated part of RoboComp")
"""

OF_2016 = Form(
    SERVER,
    """\
# -*- coding: utf-8 -*-
import sys, os, Ice, traceback, time

from PySide import *
from genericworker import *

ROBOCOMP = ''
try:
	ROBOCOMP = os.environ['ROBOCOMP']
except:
	print '$ROBOCOMP environment variable not set, using the default value /opt/robocomp'
	ROBOCOMP = '/opt/robocomp'

preStr = "-I"+ROBOCOMP+"/interfaces/ --all "+ROBOCOMP+"/interfaces/"
Ice.loadSlice(preStr+"Arm.ice")
from RoboCompArm import *

from armI import *

class SpecificWorker(GenericWorker):
	def __init__(self, proxy_map):
		super(SpecificWorker, self).__init__(proxy_map)
		self.timer.timeout.connect(self.compute)
		self.Period = 10
		self.timer.start(self.Period)
		self.number = 0
EIGHT_AND_A_TABself.mixed = u"eight blanks and a tab"

	def setParams(self, params):
		try:
			self.path = params["InnerModelPath"]
			self.width = int(params["width"])
		except Exception, e:
			traceback.print_exc()
			print "Error reading config params", e
		return True

	@QtCore.Slot()
	def compute(self):
		self.mutex.lock()
		self.number += 1
		try:
			self.touch.touched([1.5] * 2, self.number)
		except Ice.Exception, e:
			traceback.print_exc()
		self.mutex.unlock()
		return True

	def joints(self, number):
		if number < 0:
			raise Stuck("negative")
		ret = []
		for each in xrange(number):
			joint = Joint()
			joint.name = str(each)
			joint.past = (each, each)
			ret.append(joint)
		return ret

	def move(self, name, to):
		return [name == self.path, Mode.moving, [to]][0], Mode.moving, [to]

	def where(self, picture, paths):
		assert isinstance(picture, str if sys.version_info[0] == 2 else bytes)
		return Frame(len(picture), sum(paths["left"]))

	def halt(self):
		self.timer.stop()
""".replace("EIGHT_AND_A_TAB", " " * 8 + "\t"),
    CONFIG,
    {"src/genericworker.py": THEIRS, "src/armI.py": THEIRS, "src/arm.py": THEIRS},
)

OF_2019 = Form(
    SERVER,
    """\
from PySide2 import QtGui, QtCore
from genericworker import *


class SpecificWorker(GenericWorker):
    def __init__(self, proxy_map):
        super(SpecificWorker, self).__init__(proxy_map)
        self.timer.timeout.connect(self.compute)
        self.Period = 10
        self.timer.start(self.Period)
        self.number = 0

    def __del__(self):
        print('SpecificWorker destructor')

    def setParams(self, params):
        self.path = params["InnerModelPath"]
        return True

    @QtCore.Slot()
    def compute(self):
        self.number += 1
        self.touch_proxy.touched([1.5, 1.5], self.number)
        return True

    def Arm_joints(self, number):
        if number < 0:
            raise Stuck("negative", number)
        return [Joint(str(each), past=[each, each]) for each in range(number)]

    def Arm_move(self, name, to):
        return name == self.path, Mode.moving, Path([to])

    def Arm_where(self, picture, paths):
        return RoboCompFrame.Frame(len(picture), sum(paths["left"]))

    def Arm_halt(self):
        self.timer.stop()
""",
    CONFIG,
    {"src/genericworker.py": THEIRS},
)

OF_2021 = Form(
    SERVER,
    '''\
#!/usr/bin/python3
from PySide2.QtCore import QTimer
from PySide2.QtWidgets import QApplication
from rich.console import Console
from genericworker import *
import interfaces as ifaces
from lib.names import name_of

sys.path.append('/opt/robocomp/lib')
console = Console(highlight=False)


class SpecificWorker(GenericWorker):
    def __init__(self, proxy_map, startup_check=False):
        super(SpecificWorker, self).__init__(proxy_map)
        self.Period = 10
        self.number = 0
        if startup_check:
            self.startup_check()
        else:
            self.timer.timeout.connect(self.compute)
            self.timer.start(self.Period)

    def __del__(self):
        """Destructor"""

    def setParams(self, params):
        self.path = params["InnerModelPath"]
        return True

    @QtCore.Slot()
    def compute(self):
        self.number += 1
        self.touch_proxy.touched([1.5, 1.5], self.number)
        return True

    def startup_check(self):
        print(f"Testing RoboCompArm.Joint from ifaces.RoboCompArm")
        test = ifaces.RoboCompArm.Joint()
        QTimer.singleShot(200, QApplication.instance().quit)

    def Arm_joints(self, number):
        if number < 0:
            raise ifaces.RoboCompArm.Stuck("negative", number)
        ret = ifaces.RoboCompArm.Joints()
        for each in range(number):
            joint = ifaces.RoboCompArm.Joint()
            joint.name = name_of(each)
            joint.past = ifaces.RoboCompArm.Path([each])
            joint.past.append(each)
            ret.append(joint)
        return ret

    def Arm_move(self, name, to):
        ret = bool()
        ret = name == self.path
        mode = ifaces.RoboCompArm.Mode.moving
        path = ifaces.RoboCompArm.Path()
        path.append(to)
        return (ret, mode, path)

    def Arm_where(self, picture, paths):
        ret = ifaces.RoboCompArm.RoboCompFrame.Frame()
        ret.x = len(picture)
        ret.y = sum(paths["left"])
        return ret

    def Arm_halt(self):
        self.timer.stop()
''',
    CONFIG,
    {"src/genericworker.py": THEIRS, "src/interfaces.py": THEIRS, "src/lib/names.py": "name_of = str\n"},
)

OF_2025 = Form(
    SERVER,
    """\
#!/usr/bin/python3
from PySide6.QtCore import QTimer
from PySide6.QtWidgets import QApplication
from rich.console import Console
from genericworker import *
import interfaces as ifaces
try:
    from .names import name_of
except ImportError:
    from names import name_of
from src.names import name_of as the_same

sys.path.append('/opt/robocomp/lib')
console = Console(highlight=False)


class SpecificWorker(GenericWorker):
    def __init__(self, proxy_map, configData, startup_check=False):
        super(SpecificWorker, self).__init__(proxy_map, configData)
        self.Period = configData["Period"]["Compute"]
        self.path = configData["InnerModelPath"]
        assert self.configData["fast"] is True and configData["width"] == 640
        assert configData["Robot"]["Name"] == "left arm"
        assert name_of is the_same
        self.number = 0
        if startup_check:
            self.startup_check()
        else:
            self.timer.timeout.connect(self.compute)
            self.timer.start(self.Period)

    @QtCore.Slot()
    def compute(self):
        self.number += 1
        self.touch_proxy.touched([1.5, 1.5], self.number)

    def startup_check(self):
        QTimer.singleShot(200, QApplication.instance().quit)

    def Arm_joints(self, number):
        if number < 0:
            raise ifaces.RoboCompArm.Stuck(what="negative", joint=number)
        return [ifaces.RoboCompArm.Joint(name=name_of(each), past=[each, each]) for each in range(number)]

    def Arm_move(self, name, to):
        return name == self.path, ifaces.RoboCompArm.Mode.moving, [to]

    def Arm_where(self, picture, paths):
        return ifaces.RoboCompFrame.Frame(x=len(picture), y=sum(paths["left"]))

    def Arm_halt(self):
        self.timer.stop()
""",
    CONFIG + "Period.Compute = 10\nPeriod.Emergency = 500\n",
    {"generated/genericworker.py": THEIRS, "generated/interfaces.py": THEIRS, "src/names.py": "name_of = str\n"},
)

FORMS = {"2016": OF_2016, "2019": OF_2019, "2021": OF_2021, "2025": OF_2025}
"""By the year in which a generator began to write this form."""

BARE = """\
from genericworker import *
import interfaces as ifaces

class SpecificWorker(GenericWorker):
    def __init__(self, proxy_map, startup_check=False):
        super(SpecificWorker, self).__init__(proxy_map)
        self.Period = 10
        self.seen = []
        self.timer.timeout.connect(self.compute)
        self.timer.start(self.Period)

    def setParams(self, params):
        return True

    @QtCore.Slot()
    def compute(self):
        pass
"""
"""A specific part to which a test adds what it is about."""

ASKER = Form(
    CLIENT,
    BARE.replace("        pass\n", "        self.seen.append(self.arm_proxy.move('etc/model.xml', 2.0))\n")
    + """\

    def Touch_touched(self, forces, number):
        self.seen.append(forces)
""",
)


def made(folder: Path, form: Form, **instead: str) -> Path:
    """A component's folder with its generic part added; `instead` replaces the text of a file, `worker` of its own."""
    for name, text in {**form.files, **_named(instead)}.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    models = tuple((folder / name).read_text() for name in sorted(form.files) if name.endswith("dsl"))
    before = digests(folder)
    if models in _GENERATED and (_GENERATED[models] / "generic").is_dir():
        shutil.copytree(_GENERATED[models] / "generic", folder / "generic")
    else:
        assert rcgen([str(folder)]) == 0
        _GENERATED[models] = folder
    after = digests(folder)
    assert before.items() <= after.items()
    assert {name.partition("/")[0] for name in after.keys() - before.keys()} <= {"generic", "etc"}
    return folder


_GENERATED: dict[tuple[str, ...], Path] = {}
"""Where there is a generic part of these models already: it depends on nothing else."""


def _named(texts: Mapping[str, str]) -> dict[str, str]:
    names = {"worker": "src/specificworker.py", "cdsl": "arm.cdsl", "config": "etc/config"}
    return {names.get(name, name): text for name, text in texts.items()}


def digests(folder: Path) -> dict[str, str]:
    """The SHA-256 of every file."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in folder.rglob("*")
        if path.is_file() and path.suffix != ".pyc"
    }
