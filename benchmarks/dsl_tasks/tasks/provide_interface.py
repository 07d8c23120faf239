"""Make a component provide a new interface: how loud the talker is can be asked and changed."""

from __future__ import annotations

import math
from functools import partial

from robocomp_py.testing.components import ComponentTest, load_component

from ..project import Project

TITLE = "provide a new interface"


def with_dsl(project: Project) -> None:
    project.write(
        "Volume.idsl",
        """\
module RoboCompVolume
{
    interface Volume
    {
        // How loud it is, 0 to 1.
        [query] float getVolume();
        // Be so loud from now on, 0 to 1.
        [command] void setVolume(float volume);
    };
};
""",
    )
    project.replace(
        "talker/talker.cdsl", 'import "../Speech.idsl";\n', 'import "../Speech.idsl";\nimport "../Volume.idsl";\n'
    )
    project.replace("talker/talker.cdsl", "implements Speech;", "implements Speech, Volume;")
    project.generate("talker")
    _both(project)


def by_hand(project: Project) -> None:
    project.write(
        "talker/generic/RoboCompVolume.py",
        """\
from __future__ import annotations

from robocomp_py.runtime.api import FLOAT32, Field, Interface, Operation, Pattern

VOLUME_INTERFACE = Interface(
    "RoboCompVolume::Volume",
    (
        Operation(
            "RoboCompVolume::Volume",
            "getVolume",
            outputs=(Field("ret", FLOAT32),),
            pattern=Pattern.QUERY,
        ),
        Operation(
            "RoboCompVolume::Volume",
            "setVolume",
            inputs=(Field("volume", FLOAT32),),
            pattern=Pattern.COMMAND,
        ),
    ),
)
""",
    )
    worker = "talker/generic/genericworker.py"
    project.replace(worker, "from . import RoboCompSpeech\n", "from . import RoboCompSpeech, RoboCompVolume\n")
    project.replace(
        worker,
        "        ports=(Port(Verb.IMPLEMENTS, RoboCompSpeech.SPEECH_INTERFACE),),\n",
        """\
        ports=(
            Port(Verb.IMPLEMENTS, RoboCompSpeech.SPEECH_INTERFACE),
            Port(Verb.IMPLEMENTS, RoboCompVolume.VOLUME_INTERFACE),
        ),
""",
    )
    project.replace(
        worker,
        "        IDSL: [query] void say(datasayin pin, out dataresponse pout)\n" + '        """\n',
        """\
        IDSL: [query] void say(datasayin pin, out dataresponse pout)
        \"\"\"

    @abstractmethod
    def Volume_getVolume(self) -> float:
        \"\"\"How loud it is, 0 to 1.\"\"\"

    @abstractmethod
    def Volume_setVolume(self, volume: float) -> None:
        \"\"\"Be so loud from now on, 0 to 1.\"\"\"
""",
    )
    _both(project)


def _both(project: Project) -> None:
    project.replace(
        "talker/specificworker.py",
        "        self.texts: list[str] = []\n",
        "        self.texts: list[str] = []\n        self.volume = 0.5\n",
    )
    project.replace(
        "talker/specificworker.py",
        "        return dataresponse(ok=True, text=pin.text)\n",
        """\
        return dataresponse(ok=True, text=pin.text)

    def Volume_getVolume(self) -> float:
        return self.volume

    def Volume_setVolume(self, volume: float) -> None:
        self.volume = min(max(volume, 0.0), 1.0)
""",
    )


def behaves(project: Project) -> None:
    """It is as loud as it was told to be, within its limits."""
    with ComponentTest(load_component(project.root / "talker")) as talker:
        for told, then in ((0.25, 0.25), (7.0, 1.0)):
            talker.send("Volume.setVolume", told)
            talker.wait_for(partial(_is_as_loud, talker, then))
    assert talker.fine


def _is_as_loud(talker: ComponentTest, volume: float) -> bool:
    return math.isclose(talker.call("Volume.getVolume"), volume)
