"""Mistakes in interfaces."""

from __future__ import annotations

from .seed import Seed

RIGHT = {
    "Geometry.idsl": """\
module RoboCompGeometry
{
    struct Point
    {
        float x;
        float y = 0.5;
    };
    sequence<Point> Path;
};
""",
    "Arm.idsl": """\
// The arm of the robot.
import "Geometry.idsl";

module RoboCompArm
{
    enum JointName { shoulder, elbow, wrist };
    exception OutOfReach { float distance; };
    struct Joint
    {
        JointName name = elbow;
        float angle;
        RoboCompGeometry::Point tip;
    };
    sequence<Joint> Joints;
    dictionary<string, Joint> JointMap;

    interface Arm
    {
        [query] float getAngle(JointName name) throws OutOfReach;
        [command] void moveTo(Joint target, float speed);
        void followPath(RoboCompGeometry::Path path, out bool arrived);
    };
};
""",
}

_ARM = "Arm.idsl"

SEEDS = [
    Seed("two letters of a type swapped", "unknown-type", _ARM, {"sequence<Joint>": "sequence<«Jiont»>"}),
    Seed("a built-in type misspelt", "unknown-type", _ARM, {"float angle;": "«flaot» angle;"}),
    Seed(
        "an action called a query",
        "wrong-action",
        _ARM,
        {"out bool arrived);": "out bool arrived) «feedback(float left)»;"},
    ),
    Seed("a type of C++", "unknown-type", _ARM, {"float angle;": "«uint» angle;"}),
    Seed(
        "a type of another module misspelt",
        "unknown-type",
        _ARM,
        {"RoboCompGeometry::Path path": "«RoboCompGeometry::Paht» path"},
    ),
    Seed(
        "an import forgotten",
        "missing-import",
        _ARM,
        {
            'import "Geometry.idsl";': "",
            "RoboCompGeometry::Point tip;": "«RoboCompGeometry::Point» tip;",
            "RoboCompGeometry::Path path, ": "",
        },
    ),
    Seed("an imported file misspelt", "missing-import", _ARM, {'"Geometry.idsl"': '"«Geomtry.idsl»"'}),
    Seed("a semicolon forgotten behind a field", "syntax", _ARM, {"        float angle;": "        float angl«e»"}),
    Seed("a semicolon forgotten behind an operation", "syntax", _ARM, {"float speed);": "float speed«)»"}),
    Seed("a block not closed", "syntax", _ARM, {"float distance; };\n    struct": "float distance;\n    «struct»"}),
    Seed("a parenthesis not closed", "syntax", _ARM, {"getAngle(JointName name)": "getAngle(JointName nam«e»"}),
    Seed("a keyword misspelt", "syntax", _ARM, {"    interface Arm": "    «interfce» Arm"}),
    Seed("an array as in C", "syntax", _ARM, {"float angle;": "float angle«[»3];"}),
    Seed("two fields in one", "syntax", _ARM, {"float angle;": "float angle«,» speed;"}),
    Seed("a semicolon too many", "stray-semicolon", _ARM, {"float angle;": "float angle;«;»"}, "warning"),
    Seed(
        "the end of an include guard",
        "stray-endif",
        "Geometry.idsl",
        {"    sequence<Point> Path;\n};": "    sequence<Point> Path;\n};\n«#endif»"},
        "warning",
    ),
    Seed("a line for the preprocessor", "stray-directive", _ARM, {"// The arm of the robot.": "«#pragma once»"}),
    Seed(
        "a second module in one file",
        "trailing-text",
        "Geometry.idsl",
        {"    sequence<Point> Path;\n};": "    sequence<Point> Path;\n};\n«module» RoboCompMore { };"},
    ),
    Seed(
        "a pasted definition",
        "duplicate",
        _ARM,
        {"    sequence<Joint> Joints;": "    sequence<Joint> Joints;\n    sequence<float> «Joints»;"},
    ),
    Seed("a field twice", "duplicate", _ARM, {"float angle;": "float angle;\n        float «angle»;"}),
    Seed("an enumerator twice", "duplicate-enumerator", _ARM, {"elbow, wrist": "elbow, «elbow»"}),
    Seed("a default that is no enumerator", "bad-default", _ARM, {"name = elbow": "name = «ellbow»"}),
    Seed("a default in quotes", "bad-default", "Geometry.idsl", {"y = 0.5": 'y = «"0.5"»'}),
    Seed("an exception misspelt", "unknown-exception", _ARM, {"throws OutOfReach": "throws «OutOfReech»"}),
    Seed("a struct thrown", "throws-non-exception", _ARM, {"throws OutOfReach": "throws «Joint»"}),
    Seed("a command that returns", "one-way-gives-back", _ARM, {"[command] void moveTo": "[command] «bool» moveTo"}),
    Seed("a command with an output", "one-way-gives-back", _ARM, {"float speed)": "«out float speed»)"}),
    Seed("an operation overloaded", "overload", _ARM, {"void followPath(": "void «moveTo»("}),
    Seed("a struct as a key", "bad-key", _ARM, {"dictionary<string, Joint>": "dictionary<«Joint», string>"}),
    Seed("records of structs with texts", "not-flat", _ARM, {"sequence<Joint>": "[records] sequence<«Joint»>"}),
    Seed("a type that contains itself", "recursive-type", _ARM, {"float angle;": "«Joint» angle;"}),
    Seed("an interface as a type", "not-a-value-type", _ARM, {"out bool arrived": "out «Arm» arrived"}),
    Seed(
        "a base misspelt",
        "unknown-interface",
        _ARM,
        {"    interface Arm": "    interface Limb { };\n    interface Arm extends «Limp»"},
    ),
    Seed("an enumerator too large", "out-of-range", _ARM, {"elbow, wrist": "elbow = «5000000000», wrist = 2"}),
]

TOGETHER = {
    "two letters of a type swapped",
    "a type of another module misspelt",
    "a semicolon forgotten behind a field",
    "an enumerator twice",
    "an exception misspelt",
    "a semicolon forgotten behind an operation",
    "a command that returns",
    "a struct as a key",
    "a line for the preprocessor",
    "a keyword misspelt",
    "a default in quotes",
}

BESIDE_A_MISSING_IMPORT = {
    "an imported file misspelt",
    "two letters of a type swapped",
    "a built-in type misspelt",
    "an enumerator twice",
    "an exception misspelt",
    "a command that returns",
    "a default that is no enumerator",
    "a semicolon forgotten behind an operation",
}
