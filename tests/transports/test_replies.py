"""Requests that are repeated are answered from what was answered before."""

from __future__ import annotations

from robocomp_py.transports.base import Reply, Status
from robocomp_py.transports.replies import LARGEST, Replies


def ok(payload: bytes) -> Reply:
    return Reply(Status.OK, payload)


def test_a_repeated_request_is_answered_as_the_first_one_was() -> None:
    replies, first, second = Replies(), list[Reply](), list[Reply]()
    replies.begin((7, 1), first.append)(ok(b"a"))
    again = replies.repeat((7, 1), second.append)
    assert again is not None
    again()
    assert first == second == [ok(b"a")]


def test_while_a_request_is_under_way_its_reply_goes_to_where_it_was_last_asked_for() -> None:
    replies, first, second = Replies(), list[Reply](), list[Reply]()
    answer = replies.begin((7, 1), first.append)
    again = replies.repeat((7, 1), second.append)
    assert again is not None
    again()
    answer(ok(b"a"))
    assert (first, second) == ([], [ok(b"a")])


def test_a_request_repeated_while_its_reply_is_being_kept_is_not_executed_again() -> None:
    class Slow(Replies):
        def keep(self, asked: tuple[int, int], reply: Reply) -> None:
            known.append(self.repeat(asked, second.append) is not None)
            super().keep(asked, reply)
            known.append(self.repeat(asked, second.append) is not None)

    known, first, second = list[bool](), list[Reply](), list[Reply]()
    Slow().begin((7, 1), first.append)(ok(b"a"))
    assert known == [True, True]
    assert (first, second) == ([], [ok(b"a")])


def test_of_each_client_the_last_replies_are_kept() -> None:
    replies = Replies(kept=256)
    for client in (1, 2):
        for number in range(1, 301):
            replies.keep((client, number), ok(b"%d" % number))
    assert [replies.find((1, number)) for number in (44, 45, 300)] == [None, ok(b"45"), ok(b"300")]
    assert replies.find((2, 45)) == ok(b"45")
    assert replies.repeat((1, 44), list[Reply]().append) is None


def test_their_memory_is_bounded() -> None:
    replies = Replies(octets=1000)
    for number in range(100):
        replies.keep((number % 10, number), ok(bytes(100)))
    assert sum(replies.find((number % 10, number)) is not None for number in range(100)) == 10
    replies.keep((1, 1000), ok(bytes(LARGEST + 1)))
    assert replies.find((1, 1000)) is None
    replies.keep((1, 1001), Reply(Status.OK, [bytes(500), bytes(600)]))
    assert replies.find((1, 1001)) is None


def test_what_was_executed_twice_is_kept_and_counted_once() -> None:
    replies = Replies(octets=1000)
    for number in range(100):
        replies.keep((1, 1), ok(b"%100d" % number))
    assert replies.find((1, 1)) == ok(b"%100d" % 99)
