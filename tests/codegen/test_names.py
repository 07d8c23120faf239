"""What operations and their arguments are called in Python."""

from __future__ import annotations

import pytest

from robocomp_py.codegen.names import loan_arguments, twin
from robocomp_py.contract.interface import Interface, Operation, Pattern
from robocomp_py.contract.types import UINT8, Field, Sequence, Struct

IMAGE = Struct("Test::Image", (Field("pixels", Sequence(UINT8)),))
STEREO = Struct("Test::Stereo", (Field("left", IMAGE), Field("right", IMAGE)))


@pytest.mark.parametrize(
    ("inputs", "names"),
    [
        ((Field("image", IMAGE),), ["pixels"]),
        ((Field("stereo", STEREO),), ["left_pixels", "right_pixels"]),
        ((Field("left", IMAGE), Field("right", IMAGE)), ["left_pixels", "right_pixels"]),
        ((Field("now", STEREO), Field("pixels", Sequence(UINT8))), ["now_left_pixels", "now_right_pixels", "pixels"]),
    ],
)
def test_shapes_that_would_be_called_alike_say_the_way_from_the_message_that_is_filled(
    inputs: tuple[Field, ...], names: list[str]
) -> None:
    assert loan_arguments(Operation("Test::Feed", "push", inputs, pattern=Pattern.PUBLISH)) == names


def test_a_twin_is_called_like_no_other_operation() -> None:
    operations = tuple(Operation[None]("Test::Clock", name) for name in ("now", "nowAsync", "nowAsync_", "later"))
    clock = Interface("Test::Clock", operations)
    assert [twin(each, clock) for each in operations[:2]] == ["nowAsync__", "nowAsyncAsync"]
