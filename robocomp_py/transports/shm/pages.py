"""Which pages of a heap are in use, which have memory, and which have to give theirs back. Nothing here touches any.

A page is free or taken, and warm (it has memory) or cold. Extents are placed at the lowest free pages, so memory
that was used before is used again, and what is rarely needed lies at the end.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator


class Pages:
    """Counts in pages throughout. For one thread at a time."""

    def __init__(self, size: int) -> None:
        self.size = size
        self.warm = 0
        """Pages that have memory, in use or not."""
        self.taken = 0
        self._free = [(0, size)]
        """Beginning and end of each free extent, by their order. No two of them touch."""
        self._has_memory = bytearray(size)

    def place(self, count: int) -> int | None:
        """The lowest beginning of this many free pages; None if there is none."""
        return next((begin for begin, end in self._free if end - begin >= count), None)

    def cold(self, begin: int, count: int) -> int:
        """How many of these pages have no memory."""
        return count - self._has_memory.count(1, begin, begin + count)

    def take(self, begin: int, count: int) -> int:
        """Use these pages, which are free. How many had no memory; all of them count as warm from now on."""
        at = bisect_left(self._free, (begin + 1,)) - 1
        first, last = self._free[at]
        self._free[at : at + 1] = [each for each in ((first, begin), (begin + count, last)) if each[0] < each[1]]
        self.taken += count
        if cold := self.cold(begin, count):
            self.warm += cold
            self._has_memory[begin : begin + count] = b"\1" * count
        return cold

    def give(self, begin: int, count: int) -> None:
        """These pages are free again. They keep their memory."""
        self.taken -= count
        self._release(begin, begin + count)

    def grow(self, size: int) -> None:
        """Have this many pages in all."""
        self._has_memory.extend(bytes(size - self.size))
        self._release(self.size, size)
        self.size = size

    def chill(self, keep: int) -> Iterator[tuple[int, int]]:
        """Take memory from free pages, the last ones first, until `keep` pages or fewer are warm or all free ones are
        cold. Yields where pages begin and how many they are; their memory is to be given back."""
        for first, last in reversed(self._free):
            while self.warm > keep and (end := self._has_memory.rfind(1, first, last) + 1) > first:
                begin = max(self._has_memory.rfind(0, first, end) + 1, first, end - (self.warm - keep))
                self._has_memory[begin:end] = bytes(end - begin)
                self.warm -= end - begin
                yield begin, end - begin

    def _release(self, begin: int, end: int) -> None:
        free = self._free
        at = bisect_left(free, (begin,))
        if at < len(free) and free[at][0] == end:
            end = free.pop(at)[1]
        if at and free[at - 1][1] == begin:
            at -= 1
            begin = free.pop(at)[0]
        free.insert(at, (begin, end))
