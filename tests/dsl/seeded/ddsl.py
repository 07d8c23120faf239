"""Mistakes in deployments."""

from __future__ import annotations

from .seed import Seed

RIGHT = {
    "laser.cdsl": """\
import "Laser.idsl";
import "LaserPub.idsl";

Component laser
{
    Communications { implements Laser; publishes LaserPub; };
    language python;
};
""",
    "explorer.cdsl": """\
import "Laser.idsl";
import "LaserPub.idsl";

Component explorer
{
    Communications { requires Laser; subscribesTo LaserPub; };
    language python;
};
""",
    "recorder.cdsl": """\
import "LaserPub.idsl";

Component recorder
{
    Communications { subscribesTo LaserPub qos(reliable); };
    language python;
};
""",
    "far.toml": "[component]\nperiod = 0.1\n",
    "network.ddsl": """\
import "laser.cdsl";
import "explorer.cdsl";
import "recorder.cdsl";

Deployment network
{
    middleware zeromq;
    namespace robot1;

    Component front : laser
    {
        config "far.toml";
        ip localhost;
        port 10003;
    };
    Component rear : laser { port 10004; };
    Component explorer
    {
        dependences front, rear;
        requires Laser from front;
        env LOG "no";
    };
};
""",
}

_FILE = "network.ddsl"

SEEDS = [
    Seed("a component misspelt", "unknown-component", _FILE, {"front : laser": "front : «lasre»"}),
    Seed(
        "an import forgotten",
        "unknown-component",
        _FILE,
        {'import "explorer.cdsl";': "", "Component explorer": "Component «explorer»"},
    ),
    Seed("an imported file misspelt", "missing-import", _FILE, {'"explorer.cdsl"': '"«explorr.cdsl»"'}),
    Seed(
        "interfaces imported",
        "wrong-import",
        _FILE,
        {'"explorer.cdsl"': '"explorer.cdsl"', '"recorder.cdsl"': '"«Laser.idsl»"'},
    ),
    Seed("an instance misspelt", "unknown-instance", _FILE, {"from front": "from «frnot»"}),
    Seed("a dependence misspelt", "unknown-instance", _FILE, {"front, rear;": "front, «raer»;"}),
    Seed("a port misspelt", "unknown-port", _FILE, {"requires Laser ": "requires «Lasser» "}),
    Seed("a semicolon forgotten", "syntax", _FILE, {"port 10003;": "port 1000«3»"}),
    Seed(
        "a block not closed",
        "syntax",
        _FILE,
        {"10003;\n    };": "10003«;»\n"},
    ),
    Seed("a keyword misspelt", "syntax", _FILE, {"        dependences": "        «dependencies»"}),
    Seed("a keyword in lower case", "syntax", _FILE, {"Component rear": "«component» rear"}),
    Seed("quotes forgotten", "syntax", _FILE, {'env LOG "no"': "env LOG «no»"}),
    Seed(
        "a second deployment",
        "trailing-text",
        _FILE,
        {"    };\n};\n": "    };\n};\n«Deployment» more { };\n"},
    ),
    Seed("a port number too large", "bad-port", _FILE, {"port 10004": "port «100040»"}),
    Seed("a port twice", "port-clash", _FILE, {"port 10004": "port «10003»"}),
    Seed(
        "an instance twice",
        "duplicate",
        _FILE,
        {"{ port 10004; };": "{ port 10004; };\n    Component «rear» : laser { };"},
    ),
    Seed("a clause twice", "duplicate", _FILE, {"{ port 10004; }": "{ port 10004; «port 10005;» }"}),
    Seed("a middleware misspelt", "unknown-middleware", _FILE, {"zeromq": "«zeromk»"}),
    Seed("a middleware that stays in its process", "unfit-middleware", _FILE, {"zeromq": "«inproc»"}),
    Seed("a configuration misspelt", "missing-file", _FILE, {"far.toml": "«fra.toml»"}),
    Seed(
        "a wire forgotten",
        "ambiguous-provider",
        _FILE,
        {"requires Laser from front;": "", "Component explorer": "Component «explorer»"},
    ),
    Seed("a wire to who does not implement it", "no-provider", _FILE, {"from front": "from «explorer»"}),
    Seed(
        "two that wait for each other",
        "dependence-cycle",
        _FILE,
        {"{ port 10004; }": "{ port 10004; dependences explorer; }", "front, rear;": "front, «rear»;"},
    ),
    Seed(
        "a subscriber that asks for too much",
        "qos-mismatch",
        _FILE,
        {'"no";\n    };': '"no";\n    };\n    Component recorder { subscribesTo LaserPub from «front»; };'},
    ),
    Seed(
        "a QoS for a port misspelt",
        "unknown-port",
        _FILE,
        {"{ port 10004; }": "{ port 10004; qos «LaserPup»(depth 1); }"},
    ),
    Seed("a QoS misspelt", "bad-qos", _FILE, {"{ port 10004; }": "{ port 10004; qos LaserPub(«relible»); }"}),
    Seed(
        "two environments of one process",
        "env-clash",
        _FILE,
        {"{ port 10004; }": '{ port 10004; process p; env LOG "yes"; }', 'env LOG "no";': '«env LOG "no";» process p;'},
    ),
    Seed(
        "an address without a port",
        "ineffective-ip",
        _FILE,
        {"ip localhost;\n        port 10003;": "ip «localhost»;"},
        "warning",
    ),
    Seed(
        "a host misspelt",
        "unknown-host",
        _FILE,
        {
            "namespace robot1;": 'namespace robot1;\n    host onboard { address "192.168.1.10"; };',
            "port 10004;": "host «onbord»;",
        },
    ),
    Seed(
        "a host without an address",
        "bad-host",
        _FILE,
        {"namespace robot1;": "namespace robot1;\n    host «onboard» { user robot; };"},
    ),
    Seed(
        "a setting of a restart misspelt",
        "bad-restart",
        _FILE,
        {"port 10004;": "port 10004; restart always(«intensty» 5);"},
    ),
    Seed(
        "an interface of a named instance misspelt",
        "wrong-offers",
        _FILE,
        {"port 10004;": "port 10004; offers side : «Lasr»;"},
    ),
    Seed(
        "a setting of a clock misspelt",
        "bad-clock",
        _FILE,
        {"namespace robot1;": "namespace robot1;\n    clock front(«sped» 10);"},
    ),
    Seed(
        "a command for a shell",
        "bad-command",
        _FILE,
        {"{ port 10004; }": '{ existing "«sleep 60 | cat»"; }'},
    ),
    Seed(
        "a program that is not there",
        "missing-file",
        _FILE,
        {"{ port 10004; }": '{ existing "«no-such-program --fast»"; }'},
    ),
    Seed(
        "a program that is not named, and is to say when it is ready",
        "not-a-program",
        _FILE,
        {"{ port 10004; }": "{ port 10004; «notifies;» }"},
    ),
    Seed(
        "others started again with none",
        "ineffective-escalation",
        _FILE,
        {"namespace robot1;": "namespace robot1;\n    escalation «one_for_all»;"},
        "warning",
    ),
]

TOGETHER = {
    "a component misspelt",
    "an instance misspelt",
    "a dependence misspelt",
    "a middleware misspelt",
    "a semicolon forgotten",
    "quotes forgotten",
    "a port number too large",
    "a configuration misspelt",
    "a second deployment",
}

BESIDE_A_MISSING_IMPORT = {
    "an imported file misspelt",
    "a component misspelt",
    "an instance misspelt",
    "a dependence misspelt",
    "a port number too large",
    "a configuration misspelt",
}
