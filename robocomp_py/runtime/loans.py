"""Messages to fill in place: their arrays lie where the transport sends them from.

A transport that lends memory (`transports.base.Loan`) and a codec that says what its payloads are made
of save every copy. Elsewhere the arrays lie in ordinary memory, and the message is sent like any other;
within a process without a copy even so, because who fills an array here gives it away.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from typing import Any, TypeVar

import numpy as np

from ..contract.types import Struct, arrays
from ..errors import EncodeError, TransportError
from ..transports.base import Loan, Outlet, SupportsLoan
from ..wire.codec import Encoder, check_size
from ..wire.placing import Plan, lay, plan
from .calls import Call

M = TypeVar("M")

Shape = int | tuple[int, ...]

_Array = np.ndarray[Any, np.dtype[Any]]
_Arguments = tuple[Any, ...]
_Sizes = tuple[int, ...]

_PLANS = 32
"""For so many combinations of sizes it is remembered how such a message looked last."""


class Loans:
    """The messages of one operation that are filled where one outlet sends them from."""

    def __init__(self, call: Call[Any], outlet: Outlet) -> None:
        self._call, self._outlet = call, outlet
        inputs = call.operation.inputs
        self._is_struct = len(inputs) == 1 and isinstance(inputs[0].type, Struct)
        self._inputs = [field.attribute for field in inputs]
        found = list(arrays(inputs))
        self._places = [[field.attribute for field in path[self._is_struct :]] for path, _ in found]
        self._dtypes = [dtype for _, dtype in found]
        self._borrow = outlet.loan if isinstance(outlet, SupportsLoan) else None
        in_pieces: Callable[[Struct], Encoder] | None = getattr(call.codec, "pieces", None)
        self._pieces = in_pieces(call.operation.request) if in_pieces and self._borrow else None
        self._plans: dict[_Sizes, Plan] = {}

    @property
    def in_place(self) -> bool:
        """Whether the transport lends memory."""
        return self._pieces is not None

    @contextmanager
    def message(self, kind: type[M], shapes: Sequence[Shape], send: Callable[..., None]) -> Iterator[M]:
        """A new message with arrays of these shapes. When its block ends without an exception, it is passed on by
        `send(arguments, memory=…)`; the memory's own `send` then sends them by this outlet.
        """
        sizes = tuple(map(_size, shapes))
        with closing(self._memory(kind, sizes)) as memory:
            views = [array.reshape(shape) for array, shape in zip(memory.arrays, shapes, strict=True)]
            message = kind()
            self._put(message, views)
            try:
                yield message
            finally:
                for array in (*views, *memory.arrays):
                    array.flags.writeable = False  # whoever goes on writing to what he gave away hears of it
            send(self._arguments(message), memory=memory)

    def send(self, arguments: _Arguments, deadline: float) -> None:
        """As any message is."""
        self._outlet.send(self._call.encode(arguments), deadline)

    def _memory(self, kind: type[Any], sizes: _Sizes) -> Memory:
        try:
            check_size(sum(dtype.itemsize * size for dtype, size in zip(self._dtypes, sizes, strict=True)))
        except ValueError as exc:
            raise EncodeError(f"{self._call.operation.request.name}: {exc}") from exc
        if self._borrow and self._pieces:
            planned = self._plans.get(sizes) or self._plan(self._pieces, kind, sizes)
            try:
                loan = self._borrow(planned.size)
            except TransportError as exc:
                if type(exc) is not TransportError:  # those are what sending would raise, too
                    raise
            else:
                octets = np.frombuffer(loan.data, np.uint8)
                made = [_part(octets, *place) for place in zip(planned.places, sizes, self._dtypes, strict=True)]
                return _Lent(self, _cleared(made), loan, octets, planned, sizes)
        return Memory(self, self._new(sizes))

    def _plan(self, pieces: Encoder, kind: type[Any], sizes: _Sizes) -> Plan:
        """A guess, by a message in which all but the arrays is as it is made."""
        message, made = kind(), self._new(sizes)
        self._put(message, made)
        return self._remembered(sizes, plan(pieces(self._arguments(message)), made))

    def _remembered(self, sizes: _Sizes, planned: Plan) -> Plan:
        if len(self._plans) >= _PLANS:
            self._plans.clear()
        self._plans[sizes] = planned
        return planned

    def _new(self, sizes: _Sizes) -> list[_Array]:
        return _cleared([np.empty(size, dtype) for size, dtype in zip(sizes, self._dtypes, strict=True)])

    def _put(self, message: object, made: Sequence[_Array]) -> None:
        for path, array in zip(self._places, made, strict=True):
            owner = message
            for attribute in path[:-1]:
                owner = getattr(owner, attribute)
            setattr(owner, path[-1], array)

    def _arguments(self, message: object) -> _Arguments:
        return (message,) if self._is_struct else tuple(getattr(message, each) for each in self._inputs)

    def lay(self, arguments: _Arguments, octets: _Array, planned: Plan, sizes: _Sizes) -> slice | None:
        """Complete a message in its memory, and remember how it looked."""
        assert self._pieces
        where, better = lay(self._pieces(arguments), octets, planned)
        if better is not planned:
            self._remembered(sizes, better)
        return where


class Memory:
    """Where the arrays of one message lie, and how it is sent from there: here, as any message is."""

    def __init__(self, loans: Loans, made: Sequence[_Array]) -> None:
        self.loans, self.arrays = loans, made

    def send(self, arguments: _Arguments, deadline: float) -> None:
        self.loans.send(arguments, deadline)

    def close(self) -> None:
        """Give back what was not sent. Idempotent."""


class _Lent(Memory):
    """Memory of the transport."""

    def __init__(
        self, loans: Loans, made: Sequence[_Array], loan: Loan, octets: _Array, planned: Plan, sizes: _Sizes
    ) -> None:
        super().__init__(loans, made)
        self._loan, self._octets, self._planned, self._sizes = loan, octets, planned, sizes

    def send(self, arguments: _Arguments, deadline: float) -> None:
        where = self.loans.lay(arguments, self._octets, self._planned, self._sizes)
        if where is None:  # it has become longer than it was planned
            super().send(arguments, deadline)
        else:
            self._loan.send(where.start, where.stop, deadline)

    def close(self) -> None:
        self._loan.close()


def _part(octets: _Array, place: int, size: int, dtype: np.dtype[Any]) -> _Array:
    return octets[place : place + size * dtype.itemsize].view(dtype)


def _cleared(made: list[_Array]) -> list[_Array]:
    """These arrays; those of bools hold some, since others than 0 and 1 would be refused where they arrive."""
    for array in made:
        if array.dtype.kind == "b":
            array.fill(False)
    return made


def _size(shape: Shape) -> int:
    """How many items an array of this shape has; raises ValueError for what is none."""
    lengths = shape if isinstance(shape, tuple) else (shape,)
    if not lengths or not all(
        type(each) is not bool and isinstance(each, int | np.integer) and each >= 0 for each in lengths
    ):
        raise ValueError(f"a shape is a number of items or a tuple of such numbers, not {shape!r}")
    return math.prod(int(each) for each in lengths)
