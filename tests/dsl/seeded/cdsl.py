"""Mistakes in components."""

from __future__ import annotations

from .seed import Seed

RIGHT = {
    "explorer.pdsl": "ComponentParams explorer { max_speed float 0.8 0:2; };\n",
    "Arm.idsl": """\
module RoboCompArm
{
    interface Arm { [command] void stop(); };
};
""",
    "explorer.cdsl": """\
import "Laser.idsl";
import "LaserPub.idsl";
import "Arm.idsl";

// Finds its way.
Component explorer
{
    Communications
    {
        requires Laser(zeromq), Arm;
        implements Arm concurrent;
        subscribesTo LaserPub qos(best_effort, depth 5, lifespan 1 s);
    };
    language python;
    params "explorer.pdsl";
    period 50 ms;
};
""",
}

_FILE = "explorer.cdsl"

SEEDS = [
    Seed("an interface misspelt", "unknown-interface", _FILE, {"requires Laser(": "requires «Lsaer»("}),
    Seed(
        "an import forgotten", "missing-import", _FILE, {'import "LaserPub.idsl";': "", "To LaserPub": "To «LaserPub»"}
    ),
    Seed("an imported file misspelt", "missing-import", _FILE, {'"Arm.idsl"': '"«Amr.idsl»"'}),
    Seed("the parameters imported", "wrong-import", _FILE, {'"Arm.idsl";': '"Arm.idsl";\nimport "«explorer.pdsl»";'}),
    Seed("a semicolon forgotten behind a list", "syntax", _FILE, {"(zeromq), Arm;": "(zeromq), Ar«m»"}),
    Seed("a semicolon forgotten behind a clause", "syntax", _FILE, {"language python;": "language pytho«n»"}),
    Seed("a comma forgotten", "syntax", _FILE, {"Laser(zeromq), Arm": "Laser(zeromq«)» Arm"}),
    Seed("a verb misspelt", "syntax", _FILE, {"        implements": "        «implemnts»"}),
    Seed("a verb of another language", "syntax", _FILE, {"        subscribesTo": "        «subscribes»"}),
    Seed("a block not closed", "syntax", _FILE, {"1 s);\n    };": "1 s)«;»\n"}),
    Seed("quotes forgotten", "syntax", _FILE, {'params "explorer.pdsl"': "params «explorer».pdsl"}),
    Seed(
        "a verb that does not fit",
        "wrong-verb",
        _FILE,
        {"subscribesTo LaserPub qos": "publishes «Arm»; subscribesTo LaserPub qos"},
    ),
    Seed(
        "calls published",
        "empty-port",
        _FILE,
        {"subscribesTo LaserPub qos": "publishes «Laser»; subscribesTo LaserPub qos"},
        "warning",
    ),
    Seed("a middleware misspelt", "unknown-middleware", _FILE, {"(zeromq)": "(«zermoq»)"}),
    Seed("a QoS word misspelt", "bad-qos", _FILE, {"best_effort": "«best_efort»"}),
    Seed("a QoS without its number", "bad-qos", _FILE, {"depth 5": "«depth»"}),
    Seed("two QoS that contradict each other", "bad-qos", _FILE, {"depth 5": "«reliable»"}),
    Seed(
        "a liveliness without an end",
        "ineffective-qos",
        _FILE,
        {"best_effort, depth 5": "«liveliness manual_by_topic»"},
        "warning",
    ),
    Seed("a QoS of calls", "qos-of-calls", _FILE, {"(zeromq), Arm;": "(zeromq), Arm qos(«reliable, depth 5»);"}),
    Seed("a proxy called concurrent", "concurrent-proxy", _FILE, {"(zeromq), Arm;": "(zeromq), Arm «concurrent»;"}),
    Seed("instances of a proxy", "wrong-each", _FILE, {"(zeromq), Arm;": "(zeromq), Arm «each»;"}),
    Seed("a policy of a proxy", "wrong-policy", _FILE, {"(zeromq), Arm;": "(zeromq), Arm(«moveTo queue»);"}),
    Seed("a period without a unit", "bad-period", _FILE, {"period 50 ms": "period «50»"}),
    Seed("a unit misspelt", "bad-period", _FILE, {"period 50 ms": "period 50 «msec»"}),
    Seed("no period at all", "bad-period", _FILE, {"period 50 ms": "period «0 ms»"}),
    Seed("a clause twice", "duplicate", _FILE, {"period 50 ms;": "period 50 ms;\n    «period 20 ms;»"}),
    Seed("the parameters misspelt", "missing-file", _FILE, {'params "explorer': 'params "«explore', ".pdsl": ".pdsl»"}),
    Seed(
        "the language forgotten",
        "no-language",
        _FILE,
        {"    language python;": "", "nent explorer": "nent «explorer»"},
        "warning",
    ),
    Seed("another language", "not-python", _FILE, {"language python": "language «Cpp11»"}, "warning"),
    Seed(
        "an option misspelt",
        "unknown-option",
        _FILE,
        {"    Communications\n": "    options «dsrr»;\n    Communications\n"},
        "warning",
    ),
]

TOGETHER = {
    "an interface misspelt",
    "a semicolon forgotten behind a list",
    "a verb misspelt",
    "a middleware misspelt",
    "a QoS word misspelt",
    "a QoS without its number",
    "a unit misspelt",
    "the parameters misspelt",
    "a semicolon forgotten behind a clause",
    "an option misspelt",
}

BESIDE_A_MISSING_IMPORT = {
    "an imported file misspelt",
    "an interface misspelt",
    "an import forgotten",
    "a QoS word misspelt",
    "a unit misspelt",
    "a middleware misspelt",
}
