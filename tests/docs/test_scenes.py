"""The guides to simulated scenes do what they say."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import pytest

from robocomp_py.innermodel.tree import Tree

from .pages import ROOT, File, steps
from .reader import do

Convert = Callable[[Any], Tree]


def test_the_guide_to_scenes_works_as_written(tmp_path: Path) -> None:
    done = list(steps(ROOT / "docs" / "guides" / "scenes.md"))
    assert len(done) > 2
    for step in done:
        do(step, tmp_path)


@pytest.fixture
def convert() -> Convert:
    """The function of the script that the guide to URDF and MJCF shows."""
    [text] = [
        each.text
        for each in steps(ROOT / "docs" / "guides" / "importing.md")
        if isinstance(each, File) and each.path == "from_mujoco.py"
    ]
    names: dict[str, Any] = {"__name__": "from_mujoco"}
    exec(compile(text, "from_mujoco.py", "exec"), names)
    made: Convert = names["convert"]
    return made


def mjcf(world: str, assets: str = "") -> Any:
    return mujoco.MjModel.from_xml_string(f"<mujoco>{assets}<worldbody>{world}</worldbody></mujoco>")


def test_a_plane_of_mjcf_becomes_a_thin_box_below_it(convert: Convert) -> None:
    tree = convert(mjcf('<geom name="floor" type="plane" size="0 1.5 .05" pos="0 0 2"/>'))
    values = tree.node("floor").values
    assert values["size"] == (3000.0, 10.0, 20000.0)
    assert tree.transform("root", (0, 5 + float(str(values["py"])), 0), "floor_at") == pytest.approx((0, 2000, 0))


def test_joints_without_a_name_and_with_the_name_of_their_body_get_ids(convert: Convert) -> None:
    inner = '<body name="arm"><joint name="arm"/><geom name="arm" size=".1"/></body>'
    tree = convert(mjcf(f'<body name="root"><joint/><geom size=".1"/>{inner}</body>'))
    assert [name for name, tag in tree.tags.items() if tag == "joint"] == ["joint0", "arm_joint"]
    assert {"root_body", "geom0", "arm_geom"} <= set(tree.ids)


def test_a_free_joint_is_refused_with_the_name_of_its_body(convert: Convert) -> None:
    with pytest.raises(SystemExit, match="body cup: its joint joint0 is neither a hinge nor a slide"):
        convert(mjcf('<body name="cup"><freejoint/><geom size=".1"/></body>'))


def test_numbers_of_a_converted_scene_are_not_inexact(convert: Convert, tmp_path: Path) -> None:
    limited = '<joint type="slide" limited="true" range="-2.01 .11"/>'
    convert(mjcf(f'<body>{limited}<geom type="capsule" size=".03 .3"/></body>')).save(tmp_path / "arm.xml")
    text = (tmp_path / "arm.xml").read_text()
    assert 'size="60,660,60"' in text
    assert 'min="-2010" max="110"' in text


def test_a_height_field_is_left_out(convert: Convert, capsys: pytest.CaptureFixture[str]) -> None:
    hills = '<asset><hfield name="hills" nrow="2" ncol="2" size="1 1 1 1" elevation="0 0 1 1"/></asset>'
    assert "geom0" not in convert(mjcf('<geom type="hfield" hfield="hills"/>', hills))
    assert capsys.readouterr().out == "left out: the hfield hills\n"
