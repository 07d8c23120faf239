"""Messages that are filled in place: their arrays lie in the memory that the transport sends.

No copy is made if the transport lends memory (`transports.base.Loan`) and the codec exposes the pieces of a payload.
Otherwise the arrays lie in ordinary memory, and the message is sent like any other. Within a process that needs no copy
either, because the sender gives up the arrays.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from typing import Any, TypeVar

import numpy as np

from ..contract.types import Struct, arrays, dtypes
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
"""Maximum number of cached layouts, one for each combination of array sizes."""


class Loans:
    """Creates messages of one operation that are filled in the memory of one outlet."""

    def __init__(self, call: Call[Any], outlet: Outlet) -> None:
        self._call, self._outlet = call, outlet
        inputs = call.operation.inputs
        self._is_struct = len(inputs) == 1 and isinstance(inputs[0].type, Struct)
        self._inputs = [field.attribute for field in inputs]
        found = list(arrays(inputs))
        self._places = [[field.attribute for field in path[self._is_struct :]] for path, _ in found]
        self._dtypes = [dtypes()[item] for _, item in found]
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
        """A new message with arrays of these shapes. When the block ends without an exception,
        `send(arguments, memory=…)` is called, which may use `memory.send` to send from this outlet's memory.
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
                    array.flags.writeable = False  # writing to an array after it was sent raises an error
            send(self._arguments(message), memory=memory)

    def send(self, arguments: _Arguments, deadline: float) -> None:
        """Encode and send an ordinary message."""
        self._outlet.send(self._call.encode(arguments), deadline)

    def _memory(self, kind: type[Any], sizes: _Sizes) -> Memory:
        try:
            check_size(sum(dtype.itemsize * size for dtype, size in zip(self._dtypes, sizes, strict=True)))
        except ValueError as exc:
            raise EncodeError(f"{self._call.operation.called}: {exc}") from exc
        if self._borrow and self._pieces:
            planned = self._plans.get(sizes) or self._plan(self._pieces, kind, sizes)
            try:
                loan = self._borrow(planned.size)
            except TransportError as exc:
                if type(exc) is not TransportError:  # sending would raise the same; a plain one only means: no loan
                    raise
            else:
                octets = np.frombuffer(loan.data, np.uint8)
                made = [_part(octets, *place) for place in zip(planned.places, sizes, self._dtypes, strict=True)]
                return _Lent(self, _cleared(made), loan, octets, planned, sizes)
        return Memory(self, self._new(sizes))

    def _plan(self, pieces: Encoder, kind: type[Any], sizes: _Sizes) -> Plan:
        """Estimate the layout from a message in which everything but the arrays has its default."""
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
        """Complete a message in its memory, and cache its layout. None if it does not fit."""
        assert self._pieces
        where, better = lay(self._pieces(arguments), octets, planned)
        if better is not planned:
            self._remembered(sizes, better)
        return where


class Memory:
    """The arrays of one message, in ordinary memory. The message is encoded and sent like any other."""

    def __init__(self, loans: Loans, made: Sequence[_Array]) -> None:
        self.loans, self.arrays = loans, made

    def send(self, arguments: _Arguments, deadline: float) -> None:
        self.loans.send(arguments, deadline)

    def close(self) -> None:
        """Return memory that was not sent to the transport. Idempotent."""


class _Lent(Memory):
    """Memory of the transport: the message is sent from there."""

    def __init__(
        self, loans: Loans, made: Sequence[_Array], loan: Loan, octets: _Array, planned: Plan, sizes: _Sizes
    ) -> None:
        super().__init__(loans, made)
        self._loan, self._octets, self._planned, self._sizes = loan, octets, planned, sizes

    def send(self, arguments: _Arguments, deadline: float) -> None:
        where = self.loans.lay(arguments, self._octets, self._planned, self._sizes)
        if where is None:  # the message is longer than the memory
            super().send(arguments, deadline)
        else:
            self._loan.send(where.start, where.stop, deadline)

    def close(self) -> None:
        self._loan.close()


def _part(octets: _Array, place: int, size: int, dtype: np.dtype[Any]) -> _Array:
    return octets[place : place + size * dtype.itemsize].view(dtype)


def _cleared(made: list[_Array]) -> list[_Array]:
    """Set arrays of bools to False, since receivers refuse values other than 0 and 1. Returns the arrays."""
    for array in made:
        if array.dtype.kind == "b":
            array.fill(False)
    return made


def _size(shape: Shape) -> int:
    """The number of items of an array of this shape. Raises ValueError if it is not a valid shape."""
    lengths = shape if isinstance(shape, tuple) else (shape,)
    if not lengths or not all(
        type(each) is not bool and isinstance(each, int | np.integer) and each >= 0 for each in lengths
    ):
        raise ValueError(f"a shape is a number of items or a tuple of numbers, not {shape!r}")
    return math.prod(int(each) for each in lengths)
