"""What the component `workshop` of the tests does."""

from __future__ import annotations

from .generic.genericworker import GenericWorker
from .generic.RoboCompWorkshop import Missing, Octets, Quality, Tool, Trouble

HAMMER, SAW = Tool("hammer", Quality.good, 1.5), Tool("Säge", Quality.bad, 0.25)


class SpecificWorker(GenericWorker):
    def initialize(self) -> None:
        self.shelves: list[int] = []

    def Workshop_divide(self, dividend: int, divisor: int) -> tuple[int, int]:
        if divisor == 0:
            raise Trouble("division by zero")
        return divmod(dividend, divisor)

    def Workshop_tools(self, least: Quality) -> tuple[list[Tool], dict[str, int], list[float]]:
        found = [each for each in (HAMMER, SAW) if each.quality >= least]
        return found, {each.name: 1 for each in found}, [each.weight for each in found]

    def Workshop_borrow(self, tool: Tool) -> None:
        if tool.name != "hammer":
            raise Missing("not there", tool, 7)

    def Workshop_polish(self, raw: Octets, twice: bool) -> bytes:
        return bytes(reversed(bytes(raw))) * (2 if twice else 1)

    def Workshop_fail(self, how: str) -> int:
        raise RuntimeError(how)

    def Workshop_tidy(self, shelf: int) -> None:
        self.shelves.append(shelf)

    def Workshop_tidied(self) -> int:
        return len(self.shelves)
