"""A scene as MJCF, for programs that use MuJoCo alone."""

from __future__ import annotations

from ..innermodel.tree import Tree
from .build import build

_START = "start"
"""The key frame in which all is where the scene has it."""


def exported(tree: Tree, tick: float = 0.005) -> str:
    """The text of a file of MJCF: what physics knows of a scene, with its motors, for steps of `tick` s.

    The names of its nodes begin with a dot. Sensors, cameras and pictures are left out. Raises InnerModelError for a
    scene that cannot be simulated.
    """
    scene = build(tree, tick)
    spec, model = scene.made_by.draft.spec, scene.model
    for motor in spec.actuators:  # they are tuned only once the model is there
        number = model.actuator(motor.name).id
        motor.gainprm, motor.biasprm = model.actuator_gainprm[number], model.actuator_biasprm[number]
        motor.forcerange, motor.forcelimited = (
            model.actuator_forcerange[number],
            model.actuator_forcelimited[number],
        )
    spec.add_key(name=_START, qpos=scene.start)
    text: str = spec.to_xml()
    return text
