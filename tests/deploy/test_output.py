"""What a process prints is read to its end, whatever holds us up."""

from __future__ import annotations

import asyncio
import os
import time
from collections.abc import Iterator

import pytest

from robocomp_py.deploy.launcher import output
from robocomp_py.deploy.launcher.output import LINE, Output
from robocomp_py.testing.patience import SOON

MUCH = b"noise\n" * 2000


@pytest.fixture
def pipe() -> Iterator[tuple[int, int]]:
    """The end that is read, which its reader closes, and the other one."""
    out, into = os.pipe()
    yield out, into
    os.close(into)


async def have_come(lines: list[str], count: int) -> None:
    end = time.monotonic() + SOON
    while len(lines) < count:
        assert time.monotonic() < end, f"{len(lines)} of {count} lines have come"
        await asyncio.sleep(0.002)


def test_a_throttled_process_loses_no_output_at_its_end(pipe: tuple[int, int], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(output, "_LATER", 1e9)  # for ever
    lines: list[str] = []

    async def story() -> None:
        printed = Output(pipe[0], lines.append)
        os.write(pipe[1], MUCH)
        await have_come(lines, 2000)
        os.write(pipe[1], MUCH + b"last")
        await printed.drain(0.0)

    asyncio.run(story())
    assert lines[3999:] == ["noise", "last"]


def test_a_process_that_keeps_flooding_its_pipe_does_not_delay_the_end(pipe: tuple[int, int]) -> None:
    lines: list[str] = []
    os.set_blocking(pipe[1], False)

    def refill(line: str) -> None:
        lines.append(line)
        os.write(pipe[1], b"%d\n" % len(lines))

    async def story() -> None:
        printed = Output(pipe[0], refill)
        os.write(pipe[1], MUCH)
        await printed.drain(0.0)
        with pytest.raises(BrokenPipeError):
            os.write(pipe[1], b"more")

    asyncio.run(story())
    assert len(lines) > 2000


def test_output_that_piled_up_while_the_reader_was_stopped_is_not_a_flood(
    pipe: tuple[int, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    lines: list[str] = []
    clock = time.monotonic

    async def story() -> None:
        def tell(line: str) -> None:
            lines.append(line)
            monkeypatch.setattr(loop, "time", lambda: clock() + 1e6)  # as if we had been stopped just now

        loop = asyncio.get_running_loop()
        printed = Output(pipe[0], tell)
        os.write(pipe[1], MUCH)
        await have_come(lines, 2000)
        os.write(pipe[1], b"soon\n")
        await have_come(lines, 2001)
        printed.close()

    asyncio.run(story())
    assert lines[-1] == "soon"


@pytest.mark.parametrize("end", [b"\n", b""])
def test_long_lines_are_cut_between_characters_however_they_come(pipe: tuple[int, int], end: bytes) -> None:
    lines: list[str] = []
    text = "x" + "é€😀" * 3000  # the pieces of a line, and what is read at once, end within characters of 2 to 4 bytes

    async def story() -> None:
        printed = Output(pipe[0], lines.append)
        data = text.encode() + end
        for begin in range(0, len(data), 4099):
            os.write(pipe[1], data[begin : begin + 4099])
            await asyncio.sleep(0)
        await printed.drain(0.0)

    asyncio.run(story())
    assert [len(each) for each in lines] == [LINE, LINE, 9001 - 2 * LINE]
    assert "".join(lines) == text


def test_what_is_no_text_is_shown_as_such_and_loses_nothing_else(pipe: tuple[int, int]) -> None:
    lines: list[str] = []

    async def story() -> None:
        printed = Output(pipe[0], lines.append)
        os.write(pipe[1], b"a\xffb\r\n\n" + b"y" * LINE + b"\nlast\xe2\x82")
        await printed.drain(0.0)

    asyncio.run(story())
    assert lines == ["a\ufffdb", "", "y" * LINE, "last\ufffd"]


def test_a_record_that_follows_an_unfinished_line_comes_whole(pipe: tuple[int, int]) -> None:
    lines: list[str] = []
    record = "\x1e{" + "x" * 3990 + "}"

    async def story() -> None:
        printed = Output(pipe[0], lines.append)
        os.write(pipe[1], f"loading {'.' * 500}{record}\n{record}\nmore\n".encode())
        os.write(pipe[1], ("." * 1000 + record[:3500]).encode())
        await have_come(lines, 4)
        os.write(pipe[1], (record[3500:] + "\n").encode())
        await have_come(lines, 6)
        printed.close()

    asyncio.run(story())
    assert lines == ["loading " + "." * 500, record, record, "more", "." * 1000, record]
