"""The encoding as Ice has it: the codec beside generated code, octet by octet, both ways."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from robocomp_py.contract.interface import Interface, Operation
from robocomp_py.contract.types import INT32, LINEAGE, STRING, TIME, ExceptionType, Field, Struct, thrown
from robocomp_py.dsl.workspace import Workspace
from robocomp_py.wire.ice import Ice

from ..codegen.exported import SHIPPED_FILES, exported
from ..codegen.generated import MODELS
from .messages import patiently, values
from .sayable import in_idsl, sayable_messages

if TYPE_CHECKING:  # tests that need Ice are marked; those that are not need not find it
    from .slice_opinion import Generated, Loopback

pytestmark = pytest.mark.tool

CODEC = Ice()

Message = tuple[Struct, tuple[Any, ...]]


@pytest.fixture(scope="module")
def generated(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Generated]:
    from .slice_opinion import Generated

    made = Generated(tmp_path_factory.mktemp("slice"))
    yield made
    made.close()


@pytest.fixture(scope="module")
def ice() -> Iterator[Loopback]:
    from .slice_opinion import Loopback

    opened = Loopback()
    yield opened
    opened.close()


@pytest.fixture(scope="module")
def slicing() -> Iterator[Loopback]:
    from .slice_opinion import Loopback

    opened = Loopback(sliced=True)
    yield opened
    opened.close()


def results(fields: tuple[Field, ...]) -> tuple[Field, ...]:
    """These as the outputs of an operation: the first is what it returns."""
    return tuple(Field(f"o{n}" if n else "ret", field.type) for n, field in enumerate(fields))


def check(
    ice: Loopback,
    operation: Operation[Any],
    sent: tuple[Any, ...],
    back: tuple[Any, ...],
    module_of: Callable[[str], Any],
) -> None:
    """Of a call, generated code and we write the same octets, and read them."""
    from .slice_opinion import in_ice

    module, _, interface = operation.interface.rpartition("::")
    proxy, servant = getattr(module_of(module), f"{interface}Prx"), getattr(module_of(module), interface)
    request, response = CODEC.encoder(operation.request)(sent), CODEC.encoder(operation.response)(back)
    arguments = [in_ice(f.type, each, module_of) for f, each in zip(operation.inputs, sent, strict=True)]
    returned = tuple(in_ice(f.type, each, module_of) for f, each in zip(operation.outputs, back, strict=True))
    received: list[Any] = []

    def method(*arguments: Any) -> Any:
        received[:] = arguments
        return returned if len(returned) > 1 else returned[0] if returned else None

    asked, result = ice.sent(proxy, operation.name, arguments, response)
    assert asked.hex() == request.hex()
    assert ice.answered(servant, operation, method, request) == (True, response)
    # what was read of ours is written again as it was
    assert ice.sent(proxy, operation.name, received, response)[0] == request
    assert ice.answered(servant, operation, lambda *_: result, request) == (True, response)
    for message, payload in ((operation.request, request), (operation.response, response)):
        assert CODEC.encoder(message)(CODEC.decoder(message)(payload)) == payload


@patiently
@given(message=sayable_messages())
@example(message=(Struct("Any::Empty", ()), ()))
def test_any_message_is_the_same_octets(generated: Generated, ice: Loopback, message: Message) -> None:
    kind, values = message
    inputs = tuple(Field(f"p{n}", field.type) for n, field in enumerate(kind.fields))
    operation: Operation[Any] = Operation("Any::Peer", "work", inputs, results(kind.fields))
    module = generated.of_idsl(in_idsl(operation))
    check(ice, operation, values, values, lambda name: module)


@pytest.mark.parametrize("path", SHIPPED_FILES, ids=lambda path: path.stem)
def test_calls_of_shipped_interfaces_are_the_same_octets(generated: Generated, ice: Loopback, path: Path) -> None:
    generated.load(exported(path, "slice")[0])
    check_all(ice, generated, path)


def test_calls_with_all_that_the_language_has_are_the_same_octets(
    generated: Generated, ice: Loopback, tmp_path: Path
) -> None:
    text = (MODELS / "Everything.idsl").read_text().replace("low = -1", "low = 1")
    (tmp_path / "Everything.idsl").write_text(text.replace("struct Nothing { };", "struct Nothing { int x; };"))
    (tmp_path / "Shapes.idsl").write_text((MODELS / "Shapes.idsl").read_text())
    generated.load(exported(tmp_path / "Everything.idsl", "slice")[0])
    check_all(ice, generated, tmp_path / "Everything.idsl")


def check_all(ice: Loopback, generated: Generated, path: Path) -> None:
    module = Workspace().interfaces(path)
    assert module
    operations = [each for part in module.definitions if isinstance(part, Interface) for each in part.operations]
    for operation in operations:
        check_one(ice, generated, operation)


def check_one(ice: Loopback, generated: Generated, operation: Operation[Any]) -> None:
    sent, back = (st.tuples(*(values(f.type) for f in fields)) for fields in (operation.inputs, operation.outputs))

    @settings(patiently, max_examples=10)
    @given(sent, back)
    def same_octets(sent: tuple[Any, ...], back: tuple[Any, ...]) -> None:
        check(ice, operation, sent, back, generated.__getitem__)

    same_octets()


# Exceptions.


@st.composite
def errors(draw: st.DrawFn) -> tuple[ExceptionType, tuple[Any, ...]]:
    """An exception, which may be derived from another, and the fields of one."""
    kind, fields = draw(sayable_messages())
    bases = draw(st.lists(st.integers(0, len(kind.fields)), max_size=3))
    made: ExceptionType | None = None
    begin = 0
    for number, end in enumerate([*sorted(bases), len(kind.fields)]):
        own = tuple(Field(f"f{place}", kind.fields[place].type) for place in range(begin, end))
        made, begin = ExceptionType(f"Any::X{number}", own, made), end
    assert made
    return made, fields


def within(module: str, kind: ExceptionType) -> ExceptionType:
    """An exception as one of that module."""
    base = within(module, kind.base) if kind.base else None
    return replace(kind, name=kind.name.replace("Any", module, 1), base=base)


@patiently
@given(error=errors())
def test_any_exception_is_the_same_octets(
    generated: Generated, ice: Loopback, slicing: Loopback, error: tuple[ExceptionType, tuple[Any, ...]]
) -> None:
    from .slice_opinion import in_ice

    kind, fields = error
    operation: Operation[Any] = Operation("Any::Peer", "work", (), (), (kind,))
    module = generated.of_idsl(in_idsl(operation))
    ours = within(module.__name__, kind)
    message, lineage = thrown(ours), LINEAGE.join(ours.lineage)
    payload = CODEC.encoder(message)((lineage, *fields))

    def throw() -> None:
        given = (in_ice(f.type, each, lambda name: module) for f, each in zip(kind.all_fields, fields, strict=True))
        raise getattr(module, kind.name.removeprefix("Any::"))(*given)

    def throw_again() -> None:
        raise caught

    empty = CODEC.encoder(operation.request)(())
    as_usual = ice.answered(module.Peer, operation, throw, empty)
    in_slices = slicing.answered(module.Peer, operation, throw, empty)
    caught = ice.thrown(module.PeerPrx, "work", payload)
    assert payload.hex() == (in_slices if kind.base else as_usual)[1].hex()
    assert slicing.answered(module.Peer, operation, throw_again, empty) == in_slices
    for octets in (as_usual[1], in_slices[1]):
        found = CODEC.decoder(thrown(), prefix=True)(octets)[0]
        assert lineage.startswith(found)
        assert CODEC.encoder(message)(CODEC.decoder(message)(octets)) == payload


def test_ice_catches_the_nearest_class_it_knows(generated: Generated, ice: Loopback) -> None:
    base = ExceptionType("Any::Failed", (Field("f0", INT32),))
    derived = ExceptionType("Any::FailedLate", (Field("f1", STRING), Field("f2", TIME)), base)
    module = generated.of_idsl(in_idsl(Operation("Any::Peer", "work", raises=(base, derived))))
    ours = within(module.__name__, derived)
    payload = CODEC.encoder(thrown(ours))((LINEAGE.join(ours.lineage), 7, "no time", 9))
    known = ice.thrown(module.PeerPrx, "work", payload)
    assert (type(known), known.f0, known.f1) == (module.FailedLate, 7, "no time")
    nearest = ice.thrown(module.PeerPrx, "work", payload.replace(b"::FailedLate", b"::FailedLost"))
    assert (type(nearest), nearest.f0) == (module.Failed, 7)
