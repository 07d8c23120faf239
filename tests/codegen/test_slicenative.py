"""The Slice files that a component for Ice has beside it, and what ZeroC's compiler makes of them."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import pytest

from robocomp_py.codegen.native import native
from robocomp_py.contract.component import Component

from .generated import MODELS, linked, model_in

GAUGE = """
import "Common.idsl";
module RoboCompGauge
{
    enum Mode { fast, slow = 5 };
    struct Reading { float value; Mode mode; time at; sequence<uint16> raw; };
    struct Nothing { };
    struct FloatSeq { float x; };
    sequence<Reading> Readings;
    dictionary<string, Readings> Book;
    exception Broken { string why; };
    exception Hot extends Broken { Nothing more; };
    // Something to read.
    interface Gauge
    {
        idempotent Reading read(int number, out Mode mode) throws Hot;
        Book all(RoboCompCommon::Place place, sequence<float> a, sequence<sequence<float>> b, FloatSeq c, out int n);
        [command] void reset();
        void Reading(Reading r);
    };
    interface GaugePub { [publish] void told(Reading r); };
};
"""
COMMON = "module RoboCompCommon { struct Place { float x; bool in_doors; }; };"
METER = """
import "Gauge.idsl";
Component meter
{
    Communications { implements Gauge(ice); publishes GaugePub(ice); requires Gauge; };
    language python;
};
"""


@pytest.fixture
def meter(tmp_path: Path) -> Component:
    model_in(tmp_path, Gauge_idsl=GAUGE, Common_idsl=COMMON, meter_cdsl=METER)
    return linked(tmp_path / "meter.cdsl").component


def written(component: Component) -> dict[str, str]:
    files = native(component, "ice", "Generated.")
    return {path.removeprefix("generic/ice/"): text for path, text in files.items()}


def test_a_file_is_written_for_each_module_and_includes_what_it_uses(meter: Component) -> None:
    files = written(meter)
    assert set(files) == {"RoboCompCommon.ice", "RoboCompGauge.ice", "channels.json"}
    assert '#include "RoboCompCommon.ice"' in files["RoboCompGauge.ice"]
    assert '[["underscore"]]' in files["RoboCompCommon.ice"]


@pytest.mark.parametrize(
    "line",
    [
        "        slow = 5\n",
        "        long at;  // time: nanoseconds since 1970\n",
        "    sequence<int> IntSeq;  // uint16\n",
        "    sequence<float> FloatSeq2;\n",
        "    exception Hot extends Broken\n",
        "        idempotent ::RoboCompGauge::Reading read(int number, out Mode mode) throws Hot;\n",
        "        // [command]\n        void reset();\n",
        "    // Something to read.\n    interface Gauge\n",
    ],
)
def test_types_and_operations_are_those_of_the_idsl_as_slice_has_them(meter: Component, line: str) -> None:
    assert line in written(meter)["RoboCompGauge.ice"]


def test_it_is_said_which_object_and_which_topic_a_channel_is(meter: Component) -> None:
    channels = {
        each["channel"]: each["messages"][0] for each in json.loads(written(meter)["channels.json"])["channels"]
    }
    read, told = channels["meter/Gauge/read"], channels["meter/GaugePub/told"]
    assert (read["identity"], read["operation"], read["mode"]) == ("gauge", "read", "idempotent")
    assert (told["topic"], told["operation"]) == ("GaugePub", "told")


@pytest.mark.tool
@pytest.mark.parametrize("model", ["meter", "everything"])
def test_zeroc_s_compiler_takes_them(tmp_path: Path, meter: Component, model: str) -> None:
    component = meter if model == "meter" else linked(MODELS / f"{model}.cdsl").component
    files = {name: text for name, text in written(component).items() if name.endswith(".ice")}
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    command = ["slice2py", "--output-dir", str(tmp_path), "-I", str(tmp_path), *files]
    subprocess.run(command, cwd=tmp_path, check=True, timeout=60)
