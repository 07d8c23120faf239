"""Mistakes in configurations."""

from __future__ import annotations

from .seed import Seed

RIGHT = {
    "explorer.pdsl": """\
ComponentParams explorer
{
    max_speed float 0.8 0:2;
    device string "" mandatory;
    retries int 3;
    careful bool true;
    mode enum walls {walls, random};
    List motors [1:3]
    {
        id int 1;
    };
};
""",
    "explorer.cdsl": """\
import "Laser.idsl";
import "LaserPub.idsl";

Component explorer
{
    Communications { requires Laser; publishes LaserPub; };
    language python;
    params "explorer.pdsl";
};
""",
    "config.toml": """\
namespace = "robot1"
middleware = "zeromq"

[component]
period = 0.05
log = "info"

[params]
max_speed = 0.5
device = "/dev/ttyUSB0"
retries = 3
careful = true
mode = "random"

[[params.motors]]
id = 1

[ports.laser]
deadline = 0.5

[ports.laser.getLaserData]
middleware = "zenoh"

[ports.laserpub]
qos = { reliability = "best_effort", depth = 5 }

[transports.zeromq]

[transports.ice]
message_size_max = 1000000

[transports.ice.proxies]
Laser = "laser:tcp -p 10003"
""",
}

_FILE = "config.toml"

SEEDS = [
    Seed("a table misspelt", "config-unknown-key", _FILE, {"[component]": "[«componet»]"}),
    Seed("a key misspelt", "config-unknown-key", _FILE, {"period =": "«perod» ="}),
    Seed("a parameter misspelt", "config-unknown-key", _FILE, {"max_speed =": "«max_sped» ="}),
    Seed("a port misspelt", "config-unknown-key", _FILE, {"[ports.laserpub]": "[ports.«laserpup»]"}),
    Seed(
        "an operation misspelt",
        "config-unknown-key",
        _FILE,
        {"[ports.laser.getLaserData]": "[ports.laser.«getLaserDta»]"},
    ),
    Seed("a middleware misspelt", "config-unknown-value", _FILE, {'"zeromq"': '«"zermoq"»'}),
    Seed("a level misspelt", "config-unknown-value", _FILE, {'"info"': '«"inof"»'}),
    Seed("a choice misspelt", "config-unknown-value", _FILE, {'"random"': '«"ramdom"»'}),
    Seed("a word of a QoS misspelt", "config-unknown-value", _FILE, {'"best_effort"': '«"best_efort"»'}),
    Seed("a number in quotes", "config-wrong-type", _FILE, {"retries = 3": 'retries = «"3"»'}),
    Seed("a number for a bool", "config-wrong-type", _FILE, {"careful = true": "careful = «1»"}),
    Seed("too fast", "config-out-of-range", _FILE, {"max_speed = 0.5": "max_speed = «5.0»"}),
    Seed("a period that is none", "config-out-of-range", _FILE, {"period = 0.05": "period = «-1»"}),
    Seed("an option of Ice misspelt", "config-unknown-key", _FILE, {"message_size_max": "«mesage_size_max»"}),
    Seed("a proxy misspelt", "config-bad-address", _FILE, {'"laser:tcp -p 10003"': '«"laser:tpc -p 10003"»'}),
    Seed("a proxy of nobody", "config-unknown-key", _FILE, {"\nLaser = ": "\n«Lasser» = "}),
    Seed("no space in a name", "config-bad-name", _FILE, {'"robot1"': '«"my robot"»'}),
    Seed(
        "something mandatory forgotten",
        "config-missing",
        _FILE,
        {'device = "/dev/ttyUSB0"\n': "", "[params]": "«[params]»"},
    ),
    Seed(
        "too many items",
        "config-item-count",
        _FILE,
        {"[[params.motors]]\nid = 1": "[[params.«motors»]]\nid = 1" + "\n[[params.motors]]" * 3},
    ),
    Seed("quotes forgotten", "config-syntax", _FILE, {'mode = "random"': "mode = «random»"}),
]

TOGETHER = {
    "a key misspelt",
    "a parameter misspelt",
    "a port misspelt",
    "a middleware misspelt",
    "a level misspelt",
    "a number in quotes",
    "a number for a bool",
    "no space in a name",
    "something mandatory forgotten",
    "quotes forgotten",
}
