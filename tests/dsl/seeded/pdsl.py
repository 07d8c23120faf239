"""Mistakes in parameters."""

from __future__ import annotations

from .seed import Seed

RIGHT = {
    "common.pdsl": "ComponentParams common { log_level enum info {debug, info}; };\n",
    "arm.pdsl": """\
import "common.pdsl";

ComponentParams arm
{
    device "serial port" string "/dev/ttyUSB0" mandatory;
    max_speed float 0.5 0:2;
    retries int 3 0:10;
    mirrored bool false;
    mode enum soft {soft, hard};
    List motors [1:6]
    {
        id int 1;
        limit double 3.14;
    };
};
""",
}

_FILE = "arm.pdsl"

SEEDS = [
    Seed("a type misspelt", "syntax", _FILE, {"max_speed float": "max_speed «flaot»"}),
    Seed("a type before its name", "syntax", _FILE, {"retries int": "int «retries»"}),
    Seed("a semicolon forgotten", "syntax", _FILE, {"retries int 3 0:10;": "retries int 3 0:1«0»"}),
    Seed("a default forgotten", "syntax", _FILE, {"id int 1;": "id int«;»"}),
    Seed("a bool as in Python", "syntax", _FILE, {"bool false": "bool «False»"}),
    Seed("a list not closed", "syntax", _FILE, {"3.14;\n    };\n};": "3.14;\n}«;»"}),
    Seed("a default beyond its range", "bad-default", _FILE, {"float 0.5 0:2": "float «5» 0:2"}),
    Seed("a fraction where a whole number is wanted", "bad-default", _FILE, {"int 3 0": "int «3.5» 0"}),
    Seed("a choice misspelt", "bad-default", _FILE, {"enum soft {": "enum «sotf» {"}),
    Seed("a range upside down", "bad-range", _FILE, {"0.5 0:2": "0.5 «2:0»"}),
    Seed("items upside down", "bad-range", _FILE, {"[1:6]": "[«6:1»]"}),
    Seed(
        "a parameter twice", "duplicate", _FILE, {"mirrored bool false;": "mirrored bool false;\n    «retries» int 5;"}
    ),
    Seed("a choice twice", "duplicate", _FILE, {"{soft, hard}": "{soft, «soft»}"}),
    Seed("a parameter that is imported already", "duplicate", _FILE, {"mirrored bool": "«log_level» bool"}),
    Seed("a word of Python", "reserved-name", _FILE, {"max_speed float": "«lambda» float"}),
    Seed("an imported file misspelt", "missing-import", _FILE, {'"common.pdsl"': '"«comon.pdsl»"'}),
]

TOGETHER = {
    "a type misspelt",
    "a semicolon forgotten",
    "a bool as in Python",
    "a choice misspelt",
    "items upside down",
    "a fraction where a whole number is wanted",
    "a default forgotten",
    "a parameter that is imported already",
    "a choice twice",
}

BESIDE_A_MISSING_IMPORT = {
    "an imported file misspelt",
    "a type misspelt",
    "a choice misspelt",
    "items upside down",
    "a parameter twice",
}
