"""The trees that `identity` hands over, and `messagepack` packs."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from robocomp_py.contract.types import FLOAT32, INT16, Sequence, Type
from robocomp_py.errors import DecodeError
from robocomp_py.testing.everything import Arrays, Colour, Nested, Nothing, Point, Scalars
from robocomp_py.wire.identity import Identity

from .codecs import one

CODEC = Identity()


def tree_of(kind: Type, value: Any) -> Any:
    (tree,) = CODEC.encoder(one(kind))((value,))
    return tree


def test_structs_are_lists_enumerators_ints_and_dictionaries_dicts() -> None:
    nested = Nested(
        points=[Point(1.0, 2.0)],
        names=["a"],
        colours=[Colour.green],
        by_name={"b": Point()},
        by_number={3: "c"},
        by_colour={Colour.ultraviolet: 0.5},
        rows=[[], [Point()]],
    )
    zero: list[Any] = [False, 0, 0, 0, 0, 0.0, 0, 0.0, "", 0, 0, 0, 0, 0]
    tree = tree_of(Nested.__contract__, nested)
    assert tree == [zero, [[1.0, 2.0]], ["a"], [1], {"b": [0.0, 0.0]}, {3: "c"}, {-7: 0.5}, [[], [[0.0, 0.0]]], []]


def test_everything_in_a_tree_is_of_the_plainest_type() -> None:
    scalars = Scalars(np.True_, np.int8(1), True, text=np.str_("x"), colour=np.int64(1), f32=1, f64=np.float16(2))
    tree = tree_of(Scalars.__contract__, scalars)
    assert [type(leaf) for leaf in tree] == [bool, *[int] * 4, float, int, float, str, *[int] * 5]


def test_a_float32_is_rounded_when_it_is_sent() -> None:
    rounded = float(np.float32(0.1))
    assert tree_of(FLOAT32, 0.1) == rounded
    assert tree_of(Scalars.__contract__, Scalars(f32=0.1))[5] == rounded


def test_arrays_are_read_only_leaves() -> None:
    (small,) = [leaf for leaf in tree_of(Arrays.__contract__, Arrays(small=[1, 2])) if leaf.size]
    assert (small.tolist(), small.dtype, small.flags.writeable) == ([1, 2], np.int16, False)


@pytest.mark.parametrize("tree", [[[1, 2]], [np.zeros(2, np.int32)], [b"\x01\x00"], [None]], ids=repr)
def test_another_leaf_is_refused(tree: Any) -> None:
    with pytest.raises(DecodeError, match="expected an array of int16"):
        CODEC.decoder(one(Sequence(INT16)))(tree)


def test_an_empty_struct_is_an_empty_list() -> None:
    assert tree_of(Sequence(Nothing.__contract__), [Nothing(), Nothing()]) == [[], []]
    with pytest.raises(DecodeError):
        CODEC.decoder(one(Sequence(Nothing.__contract__)))([[[1]]])
