"""Foxglove's own libraries for JavaScript read our recordings."""

from __future__ import annotations

import json
import math
import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robocomp_py.cli.rc import main as rc
from robocomp_py.contract.types import FLOAT32, Dictionary, Field, Primitive, Sequence, Struct, Type
from robocomp_py.tools.recording.bag import Options
from robocomp_py.tools.recording.mend import mend
from tests.interop.zeromq.test_node import run
from tests.tools.recording.recorded import calls_and_logs, recorded
from tests.tools.recording.recordings import filled
from tests.wire.messages import messages, patiently
from tests.wire.schemas import expected

HERE = Path(__file__).parent

Read = Callable[[Path], Any]


@pytest.fixture(scope="module")
def read(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Read]:
    """What the program tells of a file."""
    folder = tmp_path_factory.mktemp("node")
    for name in ("package.json", "package-lock.json", ".npmrc", "read.mjs"):
        shutil.copy(HERE / name, folder)
    run(folder, "npm", "ci", "--silent")
    with subprocess.Popen(
        ["node", "read.mjs"], cwd=folder, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, encoding="utf-8"
    ) as node:
        assert node.stdin
        assert node.stdout
        told, answers = node.stdin, node.stdout

        def ask(path: Path) -> Any:
            told.write(f"{path}\n")
            told.flush()
            return json.loads(answers.readline(), parse_int=_whole)

        yield ask
        told.close()


@pytest.mark.tool
@given(
    messages(),
    st.sampled_from(["none", "lz4", "zstd"]),
    st.sampled_from(["ros2msg", "omgidl"]),
)
@settings(patiently, max_examples=100)
def test_any_recorded_message_is_read(
    read: Read, sent: tuple[Struct, tuple[Any, ...]], compress: str, schema: str
) -> None:
    message, values = sent
    with TemporaryDirectory() as folder:
        (file,) = recorded(Path(folder) / "run", message, [values], Options(compress, schema)).glob("*.mcap")
        found = read(file)
    wanted = plain(message.fields, expected(message.fields, values))
    assert found == [["/any/Source/told", ["1000000000", "999999990", 1], wanted]]


@pytest.mark.tool
@pytest.mark.parametrize("schema", ["ros2msg", "omgidl"])
def test_calls_and_log_records_are_read(schema: str, read: Read, tmp_path: Path) -> None:
    (file,) = calls_and_logs(tmp_path / "run", Options(schema=schema)).glob("*.mcap")
    fine, failed, log = [each[2] for each in read(file)]
    assert (fine[1], fine[2], failed[2]) == ([["7", "2"]], [["3", "1"]], [])
    assert log[1:] == [30, "desk/arm.driver", "hot", "arm.py", "", 3]


@pytest.mark.tool
def test_what_panels_draw_is_read(read: Read, tmp_path: Path) -> None:
    beams = Sequence(Struct("RoboCompLaser::TData", (Field("angle", FLOAT32), Field("dist", FLOAT32))))
    message = Struct("RoboCompLaserPub::Push", (Field("scan", beams),))
    run_ = recorded(tmp_path / "run", message, [([(-0.5, 1000.0), (0.5, 2500.0)],)], Options())
    assert rc(["bag", "convert", str(run_), "--to", "foxglove", "-o", str(tmp_path / "drawn")]) == 0
    (file,) = (tmp_path / "drawn").glob("*.mcap")
    plain_, drawn = read(file)
    assert plain_[2] == [[[-0.5, 1000], [0.5, 2500]]]
    assert drawn[0] == "/any/Source/told/LaserScan"
    assert [each for each in drawn[2] if not isinstance(each, list)] == ["any", -0.5, 0.5]
    assert [2.5, 1] in drawn[2]


def _whole(text: str) -> float:
    """JavaScript writes large floats as whole numbers, with the digits that tell them from others."""
    return int(text) if len(text) < 12 else float(text)


def plain(fields: tuple[Field, ...], values: list[Any]) -> list[Any]:
    """As the program writes values."""
    return [_plain(each.type, value) for each, value in zip(fields, values, strict=True)]


def _plain(kind: Type, value: Any) -> Any:
    match kind:
        case Primitive.INT64 | Primitive.UINT64:
            return str(value)
        case Primitive.FLOAT32 | Primitive.FLOAT64:
            return _float(value)
        case Struct(fields=fields):
            return plain(fields, value)
        case Sequence(Sequence() | Dictionary() as item):
            return [[_plain(item, each)] for (each,) in value]
        case Sequence(item):
            return [_plain(item, each) for each in value]
        case Dictionary(key, item):
            return [[_plain(key, name), _plain(item, each)] for name, each in value]
        case _:
            return value


def _float(value: float) -> float | str:
    if math.isfinite(value):
        return "-0" if value == 0 and math.copysign(1, value) < 0 else value
    return "NaN" if math.isnan(value) else "Infinity" if value > 0 else "-Infinity"


@pytest.mark.tool
@pytest.mark.parametrize("compress", ["none", "lz4", "zstd"])
def test_a_mended_recording_is_read(read: Read, compress: str, tmp_path: Path) -> None:
    (file,) = filled(tmp_path / "run", Options(), 20, octets=300_000).glob("*.mcap")
    file.write_bytes(file.read_bytes()[:-2_000_000])
    assert "error" in read(file)
    (saved,) = mend(file, tmp_path / "whole", Options(compress))
    (whole,) = (tmp_path / "whole").glob("*.mcap")
    assert [values[0] for _, _, values in read(whole)] == list(range(saved.messages))
    assert saved.messages > 5
