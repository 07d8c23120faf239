"""Messages filled in place: what is sent is what `send` would send, and their arrays do not move without need."""

from __future__ import annotations

import contextlib
import copy
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from functools import partial, reduce
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from robocomp_py.contract import types as t
from robocomp_py.contract.component import Port
from robocomp_py.contract.interface import Interface, Operation, Pattern, Verb
from robocomp_py.contract.qos import QoS
from robocomp_py.errors import Closed, EncodeError, Timeout, TransportError
from robocomp_py.runtime.calls import Call
from robocomp_py.runtime.loans import Loans, Memory, Shape
from robocomp_py.runtime.monitor import Monitor
from robocomp_py.runtime.ports import Proxy, bind_proxy, has_subscribers
from robocomp_py.runtime.route import Route
from robocomp_py.testing.everything import Arrays
from robocomp_py.transports.base import Capability, Channel, Statistics
from robocomp_py.wire.cdr import Cdr
from robocomp_py.wire.codec import MAX_BYTES, Codec, Payload
from robocomp_py.wire.ice import Ice
from robocomp_py.wire.identity import Identity
from robocomp_py.wire.messagepack import MessagePack

from ..wire.messages import message_types, patiently, values

ROOM = 40


class Lending:
    """An outlet that lends memory; what it sent stands in `sent`."""

    def __init__(self, error: Exception | None = None) -> None:
        self.stats = Statistics()
        self.error = error
        self.refuses: Exception | None = None
        self.has_subscribers = True
        self.deadlines: list[float] = []
        self.sent: list[bytes] = []
        self.begins: list[int] = []
        self.given_back = 0
        self.octets = np.empty(0, np.uint8)

    def loan(self, size: int) -> _Loan:
        if self.error:
            raise self.error
        self.octets = np.full(size, 0xAA, np.uint8)
        return _Loan(self, self.octets)

    def send(self, payload: Payload, deadline: float = 5.0) -> None:
        self.sent.append(bytes(payload))

    def wait_peer(self, timeout: float) -> bool:
        return True

    def close(self) -> None: ...


class _Loan:
    def __init__(self, outlet: Lending, octets: np.ndarray[Any, Any]) -> None:
        self._outlet, self.data = outlet, octets.data
        self._ended = False

    def send(self, begin: int, end: int, deadline: float = 5.0) -> None:
        if self._outlet.refuses:
            raise self._outlet.refuses
        self._ended = True
        self._outlet.sent.append(bytes(self.data[begin:end]))
        self._outlet.begins.append(begin)
        self._outlet.deadlines.append(deadline)

    def close(self) -> None:
        self._outlet.given_back += not self._ended
        self._ended = True


class Plain:
    """An outlet that has no loans; it keeps payloads as they are."""

    def __init__(self) -> None:
        self.stats = Statistics()
        self.sent: list[Any] = []

    def send(self, payload: Payload, deadline: float = 5.0) -> None:
        self.sent.append(payload)

    def wait_peer(self, timeout: float) -> bool:
        return True

    def close(self) -> None: ...


def operation(*fields: t.Field) -> Operation[None]:
    return Operation("Test::Feed", "push", fields, pattern=Pattern.PUBLISH)


FRAME = operation(t.Field("text", t.STRING), t.Field("pixels", t.Sequence(t.UINT8)))
PAIR = operation(
    t.Field("first", t.Sequence(t.FLOAT64)), t.Field("text", t.STRING), t.Field("second", t.Sequence(t.FLOAT64))
)
ARRAYS = operation(t.Field("value", Arrays.__contract__))


def frame() -> Any:
    return SimpleNamespace(text="", pixels=np.empty(0, np.uint8))


def pair() -> Any:
    return SimpleNamespace(first=np.empty(0), text="", second=np.empty(0))


class Feed:
    """One operation over an outlet that lends."""

    def __init__(self, push: Operation[None], outlet: Any = None, codec: Codec | None = None) -> None:
        self.outlet = outlet or Lending()
        self.call = Call(push, codec or Cdr(ROOM))
        self.loans = Loans(self.call, self.outlet)

    def loan(self, kind: Any, *shapes: Shape) -> AbstractContextManager[Any]:
        return self.loans.message(kind, shapes, self.send)

    def send(self, arguments: tuple[Any, ...], memory: Memory) -> None:
        memory.send(arguments, 1.0)

    def expected(self, *arguments: Any) -> Any:
        return self.call.encode(arguments)


# What is sent.


@settings(patiently, max_examples=25)
@given(data=st.data(), room=st.sampled_from([0, ROOM]))
def test_a_filled_message_is_the_one_that_send_would_send(data: st.DataObject, room: int) -> None:
    fields = (t.Field("first", t.STRING), *data.draw(message_types()).fields)
    planned, meant = (data.draw(st.tuples(*(values(field.type) for field in fields))) for _ in range(2))
    final = _holding(fields, meant)
    feed = Feed(operation(*fields), codec=Cdr(room))
    contents = list(_arrays_in(fields, final))
    for _ in range(2):  # the second is planned with the first
        kind = partial(_holding, fields, copy.deepcopy(planned))
        with feed.loan(kind, *(array.size for array in contents)) as filled:
            for array, content in zip(_arrays_in(fields, filled), contents, strict=True):
                array[:] = content
            _take_over(fields, filled, final)
        assert feed.outlet.sent.pop() == bytes(feed.expected(*meant))


def _holding(fields: Sequence[t.Field], contents: tuple[Any, ...]) -> Any:
    return SimpleNamespace(**{field.attribute: each for field, each in zip(fields, contents, strict=True)})


def _arrays_in(fields: Sequence[t.Field], holder: Any) -> Iterator[np.ndarray[Any, Any]]:
    for path, _ in t.arrays(fields):
        yield reduce(getattr, [field.attribute for field in path], holder)


def _take_over(fields: Sequence[t.Field], holder: Any, source: Any) -> None:
    """Set all that is no loaned array."""
    for each in fields:
        mine, its = getattr(holder, each.attribute), getattr(source, each.attribute)
        if isinstance(each.type, t.Struct):
            _take_over(each.type.fields, mine, its)
        elif not isinstance(mine, np.ndarray):
            setattr(holder, each.attribute, its)


def test_a_struct_that_is_the_only_parameter_is_what_is_filled() -> None:
    feed = Feed(ARRAYS)
    with feed.loan(Arrays, 3, 0, 2, 0, (2, 2), 1) as filled:
        filled.octets[:] = 7
        filled.ints[:] = -1
        filled.doubles[:] = [[1, 2], [3, 4]]
        filled.flags[:] = True
    sent = Arrays(*(np.array(each) for each in ([7] * 3, [], [-1, -1], [], [1.0, 2, 3, 4], [True])))
    assert isinstance(filled, Arrays)
    assert feed.outlet.sent == [bytes(feed.expected(sent))]


def _place(array: np.ndarray[Any, Any], feed: Feed) -> int:
    return int(array.ctypes.data - feed.outlet.octets.ctypes.data)


def test_an_array_stays_where_it_was_filled_whatever_becomes_of_what_stands_before_it() -> None:
    feed = Feed(FRAME)
    for text in ("", "rgb8", "longer", "x" * 500):
        with feed.loan(frame, (30, 40, 3)) as filled:
            assert filled.pixels.shape == (30, 40, 3)
            filled.pixels[:] = 5
            filled.text = text
        (payload,) = feed.outlet.sent
        assert payload == bytes(feed.expected(text, np.full(3600, 5, np.uint8)))
        assert feed.outlet.begins == [_place(filled.pixels, feed) - payload.index(bytes([5] * 3600))]
        feed.outlet.sent.clear()
        feed.outlet.begins.clear()


def test_the_others_of_a_message_stay_from_its_second_time_on() -> None:
    feed = Feed(PAIR)
    for text in ("left", "right"):
        with feed.loan(pair, 50, 70) as filled:
            first, second = _place(filled.first, feed), _place(filled.second, feed)
            filled.first[:], filled.second[:] = 1, 2
            filled.text = text
        assert feed.outlet.sent.pop() == bytes(feed.expected(np.full(50, 1.0), text, np.full(70, 2.0)))
    distance = 400 + 4 + len("right\0") + 2 + 4
    assert second - first == distance


def test_arrays_of_eight_byte_numbers_are_aligned() -> None:
    feed = Feed(PAIR)
    with feed.loan(pair, 5, 7) as filled:
        assert filled.first.flags.aligned
        assert filled.second.flags.aligned
        filled.text = "odd"
    assert [begin % 8 for begin in feed.outlet.begins] == [4]


CHANGES: dict[str, Callable[[Any], None]] = {
    "another array": lambda filled: setattr(filled, "first", np.arange(90.0)),
    "a list": lambda filled: setattr(filled, "second", [1.0, 2.0]),
    "a part": lambda filled: setattr(filled, "first", filled.first[:20]),
    "a part from the middle": lambda filled: setattr(filled, "first", filled.first[5:20]),
    "every other": lambda filled: setattr(filled, "first", filled.first[::2]),
    "backwards": lambda filled: setattr(filled, "second", filled.second[::-1]),
    "nothing": lambda filled: setattr(filled, "first", filled.first[:0]),
    "the other one": lambda filled: setattr(filled, "first", filled.second),
    "a part of the other one": lambda filled: setattr(filled, "second", filled.first[10:40]),
    "a longer text": lambda filled: setattr(filled, "text", "x" * 5000),
    "a text that needs more room": lambda filled: setattr(filled, "text", "x" * 1300),
}


@pytest.mark.parametrize("change", CHANGES)
def test_whatever_is_assigned_instead_is_sent(change: str) -> None:
    feed = Feed(PAIR)
    for _ in range(2):
        with feed.loan(pair, 50, 70) as filled:
            filled.first[:], filled.second[:] = np.arange(50), np.arange(70)
            CHANGES[change](filled)
            expected = bytes(feed.expected(filled.first, filled.text, filled.second))
        assert feed.outlet.sent.pop() == expected


def test_two_arrays_may_change_places() -> None:
    feed = Feed(PAIR)
    with feed.loan(pair, 50, 70) as filled:
        filled.first[:], filled.second[:] = 1, 2
        filled.first, filled.second = filled.second, filled.first
    assert feed.outlet.sent == [bytes(feed.expected(np.full(70, 2.0), "", np.full(50, 1.0)))]


@pytest.mark.parametrize("outlet", [Lending, Plain])
def test_bools_that_were_not_filled_are_bools(outlet: Callable[[], Any]) -> None:
    mask = operation(t.Field("mask", t.Sequence(t.BOOL)))
    feed = Feed(mask, outlet())
    with feed.loan(lambda: SimpleNamespace(mask=None), 100):
        pass
    (found,) = Cdr(ROOM).decoder(mask.request)(feed.outlet.sent[0])
    assert not found.any()


# When nothing is sent.


def test_a_block_left_by_an_exception_sends_nothing_and_gives_the_memory_back() -> None:
    feed = Feed(FRAME)
    with pytest.raises(KeyError), feed.loan(frame, 100):
        raise KeyError("the camera")
    assert (feed.outlet.sent, feed.outlet.given_back) == ([], 1)


def test_memory_that_was_given_back_is_read_only() -> None:
    feed = Feed(FRAME)
    with contextlib.suppress(KeyError), feed.loan(frame, 100) as filled:
        raise KeyError("the camera")
    with pytest.raises(ValueError, match="read-only"):
        filled.pixels[0] = 2


def test_a_filled_message_that_does_not_fit_its_type_is_not_sent() -> None:
    feed = Feed(FRAME)
    with pytest.raises(EncodeError, match="text must be a str"), feed.loan(frame, 100) as filled:
        filled.text = 7
    assert (feed.outlet.sent, feed.outlet.given_back) == ([], 1)


def test_memory_is_given_back_when_sending_fails_or_goes_another_way() -> None:
    for late in (True, False):
        feed = Feed(FRAME)
        if late:
            feed.outlet.refuses = Timeout("too late")
            with pytest.raises(Timeout), feed.loan(frame, 100):
                pass
        else:
            with feed.loan(frame, 100) as filled:
                filled.text = "x" * 5000
        assert (feed.outlet.given_back, len(feed.outlet.sent)) == (1, 0 if late else 1)


@pytest.mark.parametrize("shape", [-1, (2, -1), 0.5, "3", None, (1, None), (), True, [3]])
def test_what_is_no_shape_is_refused_before_anything_is_borrowed(shape: Any) -> None:
    feed = Feed(FRAME)
    with pytest.raises(ValueError, match="a shape is"), feed.loan(frame, shape):
        raise AssertionError("nothing to fill")
    assert feed.outlet.octets.size == 0


def test_no_more_is_borrowed_than_a_message_may_have() -> None:
    feed = Feed(FRAME)
    with pytest.raises(EncodeError, match=f"a message may have {MAX_BYTES}"), feed.loan(frame, (100_000, 100_000)):
        raise AssertionError("nothing to fill")
    assert feed.outlet.octets.size == 0


# Whose an array is.


@pytest.mark.parametrize("outlet", [Lending, Plain])
def test_what_was_sent_cannot_be_written_any_more(outlet: Callable[[], Any]) -> None:
    feed = Feed(FRAME, outlet())
    with feed.loan(frame, (10, 10)) as filled:
        filled.pixels[:] = 1
    with pytest.raises(ValueError, match="read-only"):
        filled.pixels[0] = 2


# Where the transport has no loans.


@pytest.mark.parametrize("codec", [Cdr(), MessagePack(), Ice(), Identity()], ids=lambda codec: codec.name)
def test_without_loans_the_message_is_sent_as_usual(codec: Codec) -> None:
    feed = Feed(FRAME, Plain(), codec)
    with feed.loan(frame, (3, 5)) as filled:
        filled.text = "plain"
        filled.pixels[:] = np.arange(15).reshape(3, 5)
    (payload,) = feed.outlet.sent
    text, pixels = codec.decoder(FRAME.request)(payload)
    assert (text, pixels.tolist()) == ("plain", list(range(15)))


def test_a_codec_that_cannot_fill_in_place_gets_no_loans() -> None:
    feed = Feed(FRAME, Lending(), Identity())
    assert not feed.loans.in_place


def test_within_a_process_the_array_itself_is_handed_over() -> None:
    feed = Feed(FRAME, Plain(), Identity())
    with feed.loan(frame, (3, 5)) as filled:
        pass
    _, received = Identity().decoder(FRAME.request)(feed.outlet.sent[0])
    assert np.shares_memory(received, filled.pixels)
    assert not received.flags.writeable


def test_a_transport_that_has_no_memory_left_sends_a_copy() -> None:
    feed = Feed(FRAME, Lending(TransportError("no more samples")))
    with feed.loan(frame, 3) as filled:
        filled.pixels[:] = 1
    assert feed.outlet.sent == [bytes(feed.expected("", b"\1\1\1"))]


def test_but_what_sending_would_raise_is_raised_at_once() -> None:
    feed = Feed(FRAME, Lending(Closed("gone")))
    with pytest.raises(Closed), feed.loan(frame, 3):
        raise AssertionError("nothing to fill")


# Through a port.


class _Transport:
    """One that has nothing but outlets."""

    capabilities = Capability.RELIABLE

    def __init__(self, codec: Codec, outlet: Any) -> None:
        self.codec, self._outlet = codec, outlet

    def outlet(self, channel: Channel) -> Any:
        return self._outlet


class FeedPublisher(Proxy):
    interface = Interface("Test::Feed", (FRAME,))

    def loan_push(self, *shapes: Shape, deadline: float | None = None) -> AbstractContextManager[Any]:
        return self._loan(FRAME, _Frame, shapes, deadline)


@dataclass
class _Frame:
    text: str = ""
    pixels: NDArray[np.uint8] = field(default_factory=lambda: np.empty(0, np.uint8))


PORT = Port(Verb.PUBLISHES, FeedPublisher.interface, proxy=FeedPublisher)


def publisher(*ways: tuple[Codec, Any]) -> FeedPublisher:
    first, *others = (Route(cast("Any", _Transport(*way)), "some", "test/Feed/push", QoS(), 1.0) for way in ways)
    proxy, _ = bind_proxy(PORT, lambda port, push: replace(first, also=tuple(others)), Monitor())
    assert isinstance(proxy, FeedPublisher)
    return proxy


def test_of_several_ways_the_lending_one_is_sent_last_and_the_others_have_copies() -> None:
    lending, plain, within = Lending(), Plain(), Plain()
    proxy = publisher((MessagePack(), plain), (Cdr(ROOM), lending), (Identity(), within))
    with proxy.loan_push(1000) as filled:
        filled.pixels[:] = 3
    lending.octets[:] = 0
    decoded = [
        codec.decoder(FRAME.request)(sent)
        for codec, sent in ((Cdr(ROOM), lending.sent[0]), (MessagePack(), plain.sent[0]), (Identity(), within.sent[0]))
    ]
    assert [pixels.tolist() for _, pixels in decoded] == [[3] * 1000] * 3
    assert len(lending.begins) == 1


def test_loaned_memory_without_subscribers_is_given_back() -> None:
    lending, plain = Lending(), Plain()
    with publisher((MessagePack(), plain), (Cdr(ROOM), lending)).loan_push(10) as filled:
        filled.pixels[:] = 3
        lending.has_subscribers = False
    assert (len(plain.sent), lending.sent, lending.given_back) == (1, [], 1)


def test_a_publisher_has_subscribers_if_one_of_its_ways_has_or_cannot_tell() -> None:
    one, other = Lending(), Lending()
    proxy = publisher((Cdr(ROOM), one), (Cdr(ROOM), other))
    one.has_subscribers = False
    assert has_subscribers(proxy)
    other.has_subscribers = False
    assert not has_subscribers(proxy)
    assert has_subscribers(publisher((MessagePack(), Plain())))


def test_no_memory_is_loaned_without_subscribers() -> None:
    lending, within = Lending(), Plain()
    lending.has_subscribers = False
    with publisher((Cdr(ROOM), lending), (Identity(), within)).loan_push(10) as filled:
        filled.pixels[:] = 3
    _, pixels = Identity().decoder(FRAME.request)(within.sent[0])
    assert lending.octets.size == 0
    assert np.shares_memory(pixels, filled.pixels)


def test_the_deadline_is_the_one_given_and_must_be_one() -> None:
    lending = Lending()
    with publisher((Cdr(ROOM), lending)).loan_push(10, deadline=0.25):
        pass
    assert lending.deadlines == [0.25]
    with pytest.raises(ValueError, match="a deadline is"):
        publisher((Cdr(ROOM), lending)).loan_push(10, deadline=-1)
