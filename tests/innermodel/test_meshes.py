"""Shapes of OpenSceneGraph and of 3D Studio, which old models have."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from robocomp_py.innermodel.mesh import Mesh, read_mesh
from robocomp_py.innermodel.read import InnerModelError


def volume(mesh: Mesh) -> float:
    """Positive if all faces look outwards."""
    one, two, three = (mesh.vertices[mesh.faces[:, corner]] * (1, 1, -1) for corner in range(3))
    return float(np.einsum("ij,ij->i", one, np.cross(two, three)).sum() / 6)


BOX = """
      VertexArray Vec3Array 8
      {
        0 0 0
        1 0 0
        1 1 0
        0 1 0
        0 0 1
        1 0 1
        1 1 1
        0 1 1
      }
"""
SIDES = "0 3 2 1  4 5 6 7  0 1 5 4  2 3 7 6  1 2 6 5  3 0 4 7"
QUADS = f"PrimitiveSets 1\n{{\nDrawElementsUShort QUADS 24\n{{\n{SIDES}\n}}\n}}\n{BOX}"
OVERALL = "ColorBinding OVERALL\nColorArray Vec4Array 1\n{\n1 0 0 1\n}\n"
MATERIAL = "StateSet {\nMaterial {\ndiffuseColor FRONT 0 1 0 1\n}\n}\n"


def geode(geometry: str, inside: str = "") -> str:
    return f"Geode {{\n{inside}\nnum_drawables 1\nGeometry {{\n{geometry}}}\n}}\n"


def osg(folder: Path, text: str, scale: tuple[float, ...] = (1.0,)) -> Mesh:
    (folder / "shape.osg").write_text(text)
    return read_mesh(folder / "shape.osg", scale)


def test_a_geometry_is_read_with_its_colour(tmp_path: Path) -> None:
    box = osg(tmp_path, f'Group {{\n  name "a {{ b"\n  num_children 1\n  {geode(QUADS + OVERALL)}}}\n')
    assert (box.vertices.min(axis=0).tolist(), box.vertices.max(axis=0).tolist()) == ([0, 0, -1], [1, 1, 0])
    assert volume(box) == pytest.approx(1)
    assert np.unique(box.colours, axis=0).tolist() == [[255, 0, 0]]


def test_a_material_colours_what_has_no_colour_of_its_own(tmp_path: Path) -> None:
    assert np.unique(osg(tmp_path, geode(QUADS, MATERIAL)).colours, axis=0).tolist() == [[0, 255, 0]]
    assert np.unique(osg(tmp_path, geode(QUADS + OVERALL, MATERIAL)).colours, axis=0).tolist() == [[255, 0, 0]]
    assert np.unique(osg(tmp_path, geode(QUADS)).colours, axis=0).tolist() == [[128, 128, 128]]


def test_transforms_move_what_is_below_them(tmp_path: Path) -> None:
    matrix = "Matrix {\n2 0 0 0\n0 2 0 0\n0 0 2 0\n10 20 30 1\n}"  # a translation is the last row
    attitude = "position 1 0 0\nattitude 0 0 0.7071067811865476 0.7071067811865476\nscale 1 1 3"
    moved = osg(
        tmp_path,
        f"MatrixTransform {{\n{matrix}\nPositionAttitudeTransform {{\n{attitude}\n{geode(QUADS)}}}\n}}\n",
    )
    assert volume(moved) == pytest.approx(8 * 3)
    assert moved.vertices.min(axis=0) == pytest.approx((10 + 2 * 0, 20, -30 - 2 * 3))
    assert moved.vertices.max(axis=0) == pytest.approx((10 + 2 * 1, 20 + 2, -30))


def test_a_block_may_be_used_again(tmp_path: Path) -> None:
    matrix = "Matrix {\n1 0 0 0\n0 1 0 0\n0 0 1 0\n5 0 0 1\n}"
    box = geode(QUADS, "UniqueID Box_0")
    both = osg(tmp_path, f"Group {{\n{box}MatrixTransform {{\n{matrix}\nUse Box_0\n}}\n}}\n")
    assert volume(both) == pytest.approx(2)
    assert both.vertices[:, 0].max() == 6


@pytest.mark.parametrize(
    ("primitives", "faces"),
    [
        ("DrawArrays TRIANGLES 0 7", [[0, 1, 2], [3, 4, 5]]),
        ("DrawArrays TRIANGLE_STRIP 1 4", [[1, 2, 3], [3, 2, 4]]),
        ("DrawArrays TRIANGLE_FAN 0 4", [[0, 1, 2], [0, 2, 3]]),
        ("DrawArrays POLYGON 2 4", [[2, 3, 4], [2, 4, 5]]),
        ("DrawArrays QUAD_STRIP 0 4", [[0, 1, 3], [0, 3, 2]]),
        ("DrawArrayLengths TRIANGLES 2 2\n{\n3 3\n}", [[2, 3, 4], [5, 6, 7]]),
        ("DrawArrays LINES 0 8\nDrawArrays TRIANGLES 0 3", [[0, 1, 2]]),
    ],
)
def test_primitives_are_triangles(primitives: str, faces: list[list[int]], tmp_path: Path) -> None:
    read = osg(tmp_path, geode(f"PrimitiveSets 1\n{{\n{primitives}\n}}\n{BOX}"))
    assert read.faces.tolist() == faces


def test_a_mirrored_shape_still_looks_outwards(tmp_path: Path) -> None:
    assert volume(osg(tmp_path, geode(QUADS), (-1.0, 2.0, 3.0))) == pytest.approx(6)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "the mesh has no triangles"),
        ("Group {\n", "the block `Group` has no end"),
        ("}\n", "line 1: `}` closes nothing"),
        ("Group {\n" * 300, "line 200: more than 200 blocks in each other"),
        (geode(QUADS.replace("6 7  0", "6 9  0")), "a geometry of 8 points uses number 9"),
        (geode(QUADS.replace("1 1 0", "1 one 0")), "could not convert string to float"),
        (geode(f"PrimitiveSets 1\n{{\nDrawArrays TRIANGLES 0 900000000\n}}\n{BOX}"), "a primitive of 900000000 points"),
        ("Group {\nUniqueID a\nUse a\n}\n", "a block that uses itself"),
        ("".join(f"Group {{\nUniqueID {n}\n" + f"Use {n - 1}\n" * 9 + "}\n" for n in range(9)), "too many uses"),
        (geode(QUADS.replace("0 0 1\n", "0 0 nan\n")), "points that are not finite"),
    ],
)
def test_a_wrong_file_of_openscenegraph_is_refused(text: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(InnerModelError) as refused:
        osg(tmp_path, text)
    assert f"shape.osg: {'' if 'the mesh' in said else 'the mesh '}" in str(refused.value)
    assert said in str(refused.value)


@pytest.mark.parametrize("ending", ["ive", "osgb"])
def test_binary_files_of_openscenegraph_say_how_to_convert_them(ending: str, tmp_path: Path) -> None:
    with pytest.raises(InnerModelError, match=rf"osgconv cup\.{ending} cup\.obj"):
        read_mesh(tmp_path / f"cup.{ending}")


def chunk(kind: int, *inside: bytes) -> bytes:
    content = b"".join(inside)
    return struct.pack("<HI", kind, 6 + len(content)) + content


CORNERS = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
FACES = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]


def tetrahedron(faces: list[tuple[int, int, int]] = FACES) -> bytes:
    points = struct.pack("<H", 4) + b"".join(struct.pack("<3f", *each) for each in CORNERS)
    use = chunk(0x4130, b"sky\0", struct.pack("<3H", 2, 0, 3))
    sides = struct.pack("<H", 4) + b"".join(struct.pack("<4H", *each, 0) for each in faces)
    mesh = chunk(0x4100, chunk(0x4110, points), chunk(0x4120, sides, use))
    sky = chunk(0xAFFF, chunk(0xA000, b"sky\0"), chunk(0xA020, chunk(0x0011, bytes((0, 0, 255)))))
    return chunk(0x4D4D, chunk(0x0002, b"\3\0\0\0"), chunk(0x3D3D, sky, chunk(0x4000, b"shape\0", mesh)))


def test_a_file_of_3d_studio_is_read_with_its_colours(tmp_path: Path) -> None:
    (tmp_path / "shape.3ds").write_bytes(tetrahedron())
    read = read_mesh(tmp_path / "shape.3ds", (2.0,))
    assert volume(read) == pytest.approx(8 / 6)
    assert read.vertices.max(axis=0).tolist() == [2, 2, 0]
    assert read.colours.tolist() == [[0, 0, 255], [128, 128, 128], [128, 128, 128], [0, 0, 255]]


@pytest.mark.parametrize(
    ("octets", "said"),
    [
        (b"", "it is no file of 3D Studio"),
        (b"solid of another kind", "a chunk of kind"),
        (tetrahedron()[:-30], "a chunk of kind 4d4d has a length of"),
        (tetrahedron([(0, 1, 9)] * 4), "a mesh of 4 points uses number 9"),
        (chunk(0x4D4D), "the mesh has no triangles"),
        (chunk(0x4D4D, chunk(0x3D3D, chunk(0x4000, b"name"))), "a name has no end"),
        (chunk(0x4D4D, chunk(0x3D3D, chunk(0x4000, b"a\0", chunk(0x4100, chunk(0x4110, b"\4"))))), "ends too early"),
        (chunk(0x4D4D, chunk(0x3D3D, chunk(0x4000, b"a\0", chunk(0x4100, chunk(0x4110, b"\4\0"))))), "buffer"),
    ],
)
def test_a_wrong_file_of_3d_studio_is_refused(octets: bytes, said: str, tmp_path: Path) -> None:
    (tmp_path / "shape.3ds").write_bytes(octets)
    with pytest.raises(InnerModelError) as refused:
        read_mesh(tmp_path / "shape.3ds")
    assert f"shape.3ds: {'' if 'the mesh' in said else 'the mesh '}" in str(refused.value)
    assert said in str(refused.value)
