"""Whatever has a name, and is misspelt, is told with the name that is meant."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from . import cdsl, configuration, ddsl, idsl, pdsl, smdsl
from .test_seeded import checked

pytestmark = pytest.mark.usefixtures("standard_folders_are_empty")

_NAMES = {
    "a built-in type": (idsl, "float angle", "flaot angle", "float"),
    "a short one": (idsl, "float angle", "itn angle", "int"),
    "a type of another language": (idsl, "float angle", "uint angle", "uint32"),
    "a type": (idsl, "sequence<Joint>", "sequence<Jonit>", "Joint"),
    "a type without its module": (idsl, "out bool arrived", "out Point arrived", "RoboCompGeometry::Point"),
    "a type of another module": (idsl, "RoboCompGeometry::Path", "RoboCompGeometry::Paht", "RoboCompGeometry::Path"),
    "a module": (idsl, "RoboCompGeometry::Path", "RoboCompGeomerty::Path", "RoboCompGeometry"),
    "an exception, beside a type of a like name": (
        idsl,
        "void moveTo(Joint target, float speed);\n",
        "void moveTo(Joint target, float speed); void x() throws OutOfReech;\n    };\n    struct OutOfReecf { };\n"
        "    interface More {\n",
        "OutOfReach",
    ),
    "a base": (idsl, "    interface Arm", "    interface Limb { }; interface Arm extends Lmib", "Limb"),
    "the base of an exception": (
        idsl,
        "    struct Joint",
        "    exception Far extends OutOfReahc { };\n    struct Joint",
        "OutOfReach",
    ),
    "an enumerator": (idsl, "name = elbow", "name = elobw", "elbow"),
    "an enumerator with its enum": (idsl, "name = elbow", "name = JointName::elobw", "elbow"),
    "a bool": (idsl, "float angle;", "bool on = ture;", "true"),
    "a keyword": (idsl, "    interface", "    inteface", "interface"),
    "a pattern": (idsl, "[command]", "[comand]", "command"),
    "an imported IDSL file": (idsl, '"Geometry.idsl"', '"Geometri.idsl"', "Geometry"),
    "an imported file of a short name": (cdsl, '"Arm.idsl"', '"Amr.idsl"', "Arm"),
    "an interface": (cdsl, "requires Laser(", "requires Lasr(", "Laser"),
    "a middleware": (cdsl, "(zeromq)", "(zermq)", "zeromq"),
    "a verb": (cdsl, "        implements", "        implments", "implements"),
    "a clause": (cdsl, "    language", "    langauge", "language"),
    "a word behind an interface": (cdsl, "Arm concurrent", "Arm concurent", "concurrent"),
    "a word of a QoS": (cdsl, "best_effort", "best_efort", "best_effort"),
    "a preset of a QoS": (cdsl, "best_effort, depth 5", "sensor_dta", "sensor_data"),
    "a kind of liveliness": (cdsl, "depth 5", "liveliness atomatic", "automatic"),
    "a unit": (cdsl, "50 ms", "50 mss", "ms"),
    "an option": (cdsl, "    period", "    options agmagnet;\n    period", "agmagent"),
    "the parameters": (cdsl, '"explorer.pdsl"', '"exporer.pdsl"', "explorer.pdsl"),
    "the type of a parameter": (pdsl, "max_speed float", "max_speed flaot", "float"),
    "the value of a bool": (pdsl, "bool false", "bool fasle", "false"),
    "the value of an enum": (pdsl, "enum soft {", "enum sft {", "soft"),
    "what is behind a parameter": (pdsl, "mandatory", "mandatry", "mandatory"),
    "a list": (pdsl, "    List", "    Lst", "List"),
    "imported parameters": (pdsl, '"common.pdsl"', '"commn.pdsl"', "common"),
    "a component": (ddsl, "front : laser", "front : lasr", "laser"),
    "an instance to wait for": (ddsl, "front, rear;", "front, raer;", "rear"),
    "an instance to use": (ddsl, "from front", "from frnt", "front"),
    "a port": (ddsl, "requires Laser ", "requires Lasr ", "Laser"),
    "the middleware of a network": (ddsl, "zeromq", "zeronq", "zeromq"),
    "a clause of an instance": (ddsl, "        config", "        confg", "config"),
    "a configuration": (ddsl, '"far.toml"', '"fra.toml"', "far.toml"),
    "a program": (ddsl, 'config "far.toml"', 'path "faar.toml"', "far.toml"),
    "a state": (smdsl, "begin => drive", "begin => drvie", "drive"),
    "a state with an inside": (smdsl, ": charge\n", ": chrage\n", "charge"),
    "a clause of a state machine": (smdsl, "    states dock", "    sates dock", "states"),
    "a state machine": (smdsl, '"patrol.smdsl"', '"patrl.smdsl"', "patrol.smdsl"),
    "a table of a configuration": (configuration, "[component]", "[componet]", "component"),
    "a key of a configuration": (configuration, "period =", "perod =", "period"),
    "a configured parameter": (configuration, "max_speed =", "max_sped =", "max_speed"),
    "a configured port": (configuration, "[ports.laserpub]", "[ports.laserpup]", "laserpub"),
    "a configured operation": (configuration, ".getLaserData]", ".getLaserDta]", "getLaserData"),
    "a configured middleware": (configuration, '"zeromq"', '"zeromp"', "zeromq"),
    "a level of the log": (configuration, '"info"', '"inof"', "info"),
    "a configured choice": (configuration, '"random"', '"ramdom"', "random"),
    "a word of a configured QoS": (configuration, '"best_effort"', '"best_efort"', "best_effort"),
    "a key of a configured QoS": (configuration, "depth", "dept", "depth"),
    "a configured transport": (configuration, "[transports.zeromq]", "[transports.zeronq]", "zeromq"),
    "an imported component": (ddsl, '"explorer.cdsl"', '"explorr.cdsl"', "explorer"),
}


@pytest.mark.parametrize("name", _NAMES)
def test_a_misspelt_name_is_reported_with_the_correct_one(name: str, tmp_path: Path) -> None:
    language, right, wrong, meant = _NAMES[name]
    holder, text = next((each, text) for each, text in language.RIGHT.items() if right in text)
    found = checked({**language.RIGHT, holder: text.replace(right, wrong, 1)}, tmp_path)
    proposed = [re.findall(r"did you mean `(.+?)`\?", f"{each.message} {each.hint}") for each in found]
    assert [meant] in proposed, "\n".join(each.render() for each in found)


def test_a_missing_file_is_reported_with_the_one_beside_it(tmp_path: Path) -> None:
    (tmp_path / "explorer.idsl").write_text("module Explorer { };")
    [found] = checked({}, tmp_path, "exploer.idsl")
    assert (found.code, found.hint) == ("unreadable", "did you mean `explorer.idsl`?")


def test_a_wrong_ending_is_reported_with_the_correct_one(tmp_path: Path) -> None:
    [found] = checked({"explorer.idl": "module Explorer { };"}, tmp_path)
    assert (found.code, found.hint) == ("unknown-language", "did you mean `.idsl`?")
