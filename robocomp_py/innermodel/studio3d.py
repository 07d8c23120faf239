"""Shapes from `.3ds` files, of 3D Studio.

A file is chunks in chunks: a number of 16 bits that tells the kind, the length with these six bytes, and the content.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator

import numpy as np

from .axes import Array
from .parts import GREY, Part

_MAIN, _EDITOR, _OBJECT, _MESH, _POINTS, _FACES, _USES = 0x4D4D, 0x3D3D, 0x4000, 0x4100, 0x4110, 0x4120, 0x4130
_MATERIAL, _NAME, _DIFFUSE, _FLOATS, _BYTES = 0xAFFF, 0xA000, 0xA020, 0x0010, 0x0011


def read_3ds(octets: bytes) -> list[Part]:
    """The parts of a file. Raises ValueError for one that is wrong."""
    try:
        return list(_parts(memoryview(octets)))
    except (struct.error, IndexError, StopIteration) as exc:
        raise ValueError(f"a chunk ends too early ({exc})") from exc


def _chunks(content: memoryview) -> Iterator[tuple[int, memoryview]]:
    place = 0
    while place + 6 <= len(content):
        kind, length = struct.unpack_from("<HI", content, place)
        if length < 6 or place + length > len(content):
            raise ValueError(f"a chunk of kind {kind:04x} has a length of {length}")
        yield kind, content[place + 6 : place + length]
        place += length


def _parts(content: memoryview) -> Iterator[Part]:
    colours: dict[str, Array] = {}
    every = list(_chunks(content))
    if not every or every[0][0] != _MAIN:
        raise ValueError("it is no file of 3D Studio")
    editor = [chunk for _, main in every for chunk in _chunks(main) if chunk[0] == _EDITOR]
    chunks = [chunk for _, inner in editor for chunk in _chunks(inner)]
    for kind, inner in chunks:
        if kind == _MATERIAL:
            name, colour = _material(inner)
            colours[name] = colour
    for kind, inner in chunks:
        if kind == _OBJECT:
            _, rest = _text(inner)
            for each, mesh in _chunks(rest):
                if each == _MESH:
                    yield _mesh(mesh, colours)


def _mesh(content: memoryview, colours: dict[str, Array]) -> Part:
    vertices, faces = np.empty((0, 3)), np.empty((0, 3), dtype=np.int64)
    painted = np.empty((0, 3))
    for kind, inner in _chunks(content):
        if kind == _POINTS:
            (count,) = struct.unpack_from("<H", inner)
            vertices = np.frombuffer(inner, "<f4", 3 * count, 2).reshape(-1, 3).astype(float)
        elif kind == _FACES:
            (count,) = struct.unpack_from("<H", inner)
            faces = np.frombuffer(inner, "<u2", 4 * count, 2).reshape(-1, 4)[:, :3].astype(np.int64)
            painted = np.tile(GREY, (count, 1))
            for each, use in _chunks(inner[2 + 8 * count :]):
                if each == _USES:
                    name, rest = _text(use)
                    (number,) = struct.unpack_from("<H", rest)
                    painted[np.frombuffer(rest, "<u2", number, 2)] = colours.get(name, GREY)
    if faces.size and faces.max() >= len(vertices):
        raise ValueError(f"a mesh of {len(vertices)} points uses number {faces.max()}")
    return Part(vertices, faces, painted.astype(np.uint8))


def _material(content: memoryview) -> tuple[str, Array]:
    name, colour = "", GREY
    for kind, inner in _chunks(content):
        if kind == _NAME:
            name, _ = _text(inner)
        elif kind == _DIFFUSE:
            for each, value in _chunks(inner):
                if each == _BYTES:
                    colour = np.array(struct.unpack_from("<3B", value), dtype=float)
                elif each == _FLOATS:
                    colour = np.array(struct.unpack_from("<3f", value)) * 255
    return name, np.clip(np.nan_to_num(colour), 0, 255)


def _text(content: memoryview) -> tuple[str, memoryview]:
    """A text that ends with a 0, and what follows it."""
    octets = bytes(content[:256])
    end = octets.find(0)
    if end < 0:
        raise ValueError("a name has no end")
    return octets[:end].decode("latin-1"), content[end + 1 :]
