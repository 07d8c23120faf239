"""`rcdeploy keys`, and what `rcdeploy` says of keys and of security when it is to start a network."""

from __future__ import annotations

import datetime
import shlex
from pathlib import Path

import pytest

from robocomp_py.cli.rc import main as rc
from robocomp_py.cli.rcdeploy import main as rcdeploy
from robocomp_py.cli.rcgen import main as rcgen
from robocomp_py.deploy import certificates
from robocomp_py.deploy.certificates import Issued

INTERFACE = "module M { interface Laser { idempotent int get(int angle); }; };"
NETWORK = """
import "sensor/sensor.cdsl"; import "driver/driver.cdsl";
Deployment Patrol {{ security {}; middleware zeromq; Component sensor {{ }}; Component driver {{ }}; }};
"""


@pytest.fixture(scope="module")
def components(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("network")
    for name, verb in (("sensor", "implements"), ("driver", "requires")):
        (root / name).mkdir()
        (root / name / "Laser.idsl").write_text(INTERFACE)
        cdsl = root / name / f"{name}.cdsl"
        cdsl.write_text(
            f'import "Laser.idsl"; Component {name} {{ Communications {{ {verb} Laser; }}; language python; }};'
        )
        assert rcgen([str(cdsl)]) == 0
    return root


@pytest.fixture
def net(components: Path, tmp_path: Path, request: pytest.FixtureRequest) -> Path:
    """A network of these components, with a folder of keys that is its own."""
    for name in ("sensor", "driver"):
        (tmp_path / name).symlink_to(components / name)
    path = tmp_path / "net.ddsl"
    path.write_text(NETWORK.format("lan"))
    return path


def expire(net: Path, name: str) -> None:
    keys = net.parent / "keys" / "Patrol"
    authority = Issued((keys / "ca" / "ca.pem").read_bytes(), (keys / "ca" / "ca.key").read_bytes())
    past = datetime.datetime.now(datetime.UTC) - datetime.timedelta(days=10)
    issued = certificates.issue(authority, name, (), past, 9, serves=False)
    (keys / name / "certificate.pem").write_bytes(issued.certificate)
    (keys / name / "key.pem").write_bytes(issued.key)


def test_keys_are_made_beside_the_network_and_listed_with_their_expiry(
    net: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert rcdeploy(["keys", str(net), "--days", "90"]) == 0
    end = datetime.datetime.now(datetime.UTC) + datetime.timedelta(days=90)
    told = capsys.readouterr().out
    assert f"keys of Patrol in {net.parent / 'keys' / 'Patrol'}" in told
    assert f"certificate of sensor: made, valid until {end:%Y-%m-%d}" in told
    assert (net.parent / "keys" / "Patrol" / "sensor" / "admitted" / "driver.key").is_file()
    assert rcdeploy(["keys", str(net)]) == 0
    told = capsys.readouterr().out
    assert ": made" not in told
    assert "CURVE keys of driver: there already" in told


def test_tools_get_keys_only_on_request(net: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert rcdeploy(["keys", str(net)]) == 0
    assert "operator" not in capsys.readouterr().out
    assert rcdeploy(["keys", str(net), "--operator"]) == 0
    assert "certificate of operator@: made" in capsys.readouterr().out
    assert rcdeploy(["keys", str(net)]) == 0
    assert "certificate of operator@: there already" in capsys.readouterr().out
    assert rcdeploy(["keys", str(net), "--no-operator"]) == 0
    assert "operator@ removed" in capsys.readouterr().out


def test_the_folder_can_be_chosen(net: Path, tmp_path: Path) -> None:
    assert rcdeploy(["keys", str(net), "-o", str(tmp_path / "elsewhere")]) == 0
    assert (tmp_path / "elsewhere" / "ca" / "ca.key").is_file()


@pytest.mark.parametrize("days", ["0", "-1", "4000", "many", "nan"])
def test_an_invalid_lifetime_is_a_usage_error(net: Path, days: str) -> None:
    with pytest.raises(SystemExit) as ended:
        rcdeploy(["keys", str(net), f"--days={days}"])
    assert ended.value.code == 2


def test_a_network_without_security_lan_gets_a_hint(net: Path, capsys: pytest.CaptureFixture[str]) -> None:
    net.write_text(NETWORK.format("local"))
    assert rcdeploy(["keys", str(net)]) == 0
    assert "add `security lan;`" in capsys.readouterr().out


def test_without_keys_nothing_is_started(net: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert rcdeploy([str(net), "--for", "0"]) == 1
    told = capsys.readouterr()
    assert f"there are no keys in {net.parent / 'keys' / 'Patrol'}; run: rcdeploy keys {net}" in told.err
    assert "ready" not in told.out


def test_the_command_that_makes_them_has_the_options_that_change_the_network(
    net: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    changed = [str(net), "--middleware", "zenoh", "--set", "driver.component.period=0.2"]
    assert rcdeploy([*changed, "--for", "0"]) == 1
    command = capsys.readouterr().err.strip().partition("run: rcdeploy ")[2]
    assert shlex.split(command)[: len(changed) + 1] == ["keys", *changed]
    assert rcdeploy(shlex.split(command)) == 0
    assert rcdeploy([*changed, "--for", "0"]) == 0


def test_a_network_does_not_start_with_expired_certificates(net: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert rcdeploy(["keys", str(net)]) == 0
    expire(net, "sensor")
    assert rcdeploy([str(net), "--for", "0"]) == 1
    told = capsys.readouterr().err
    assert "the certificate of `sensor` expired on" in told
    assert "--renew" in told
    assert rcdeploy(["keys", str(net), "--renew"]) == 0
    assert rcdeploy([str(net), "--for", "0"]) == 0


def test_an_open_network_needs_an_option_to_start(net: Path, capsys: pytest.CaptureFixture[str]) -> None:
    net.write_text(NETWORK.format("open"))
    assert rcdeploy([str(net), "--for", "0"]) == 1
    assert "add --insecure" in capsys.readouterr().err
    assert rcdeploy([str(net), "--for", "0", "--insecure"]) == 0
    assert "WITHOUT SECURITY" in capsys.readouterr().err


PLUGIN = """
from robocomp_py.transports.base import Capability
from robocomp_py.transports.deployment import Deployment
from robocomp_py.transports.inproc import InprocTransport
from robocomp_py.transports.network import Wiring

class Carrier(InprocTransport):
    capabilities = Capability.CROSS_PROCESS | Capability.RELIABLE
class Far(Carrier):
    capabilities = Carrier.capabilities | Capability.CROSS_HOST
def made(config):
    return Carrier(config)
class Silent(Deployment):
    pass
class Guarded(Deployment):
    unprotected = ""
class Bare(Deployment):
    crosses_hosts = True
    def wire(self, network):
        return Wiring()
"""


def install(packages: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Transports of another package."""
    (packages / "carriers-1.0.dist-info").mkdir(parents=True)
    (packages / "carriers.py").write_text(PLUGIN)
    (packages / "carriers-1.0.dist-info" / "METADATA").write_text(
        "Metadata-Version: 2.1\nName: carriers\nVersion: 1.0\n"
    )
    (packages / "carriers-1.0.dist-info" / "entry_points.txt").write_text(
        "[robocomp_py.transports]\ncarrier = carriers:Carrier\nguarded = carriers:Carrier\nfar = carriers:Far\n"
        "made = carriers:made\nbroken = carriers:Carrier\nbare = carriers:Carrier\n"
        "[robocomp_py.deployments]\nguarded = carriers:Guarded\nmade = carriers:Silent\nbroken = nowhere:Side\n"
        "bare = carriers:Bare\n"
    )
    monkeypatch.syspath_prepend(packages)


@pytest.mark.parametrize(
    ("security", "middleware", "why"),
    [
        ("lan", "carrier", "its transport has no deployment side"),
        ("lan", "made", "its deployment side does not declare what keeps strangers out"),
        ("lan", "guarded", ""),
        ("lan", "broken", "its deployment side cannot be loaded: No module named 'nowhere'"),
        ("local", "carrier", ""),
        ("local", "far", "its transport declares that it reaches other machines"),
        ("open", "far", ""),
    ],
)
def test_a_plug_in_transport_is_allowed_what_it_declares(
    net: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    security: str,
    middleware: str,
    why: str,
) -> None:
    install(net.parent / "packages", monkeypatch)
    net.write_text(NETWORK.format(security).replace("zeromq", middleware))
    assert rc(["lint", str(net)]) == (1 if why else 0)
    told = capsys.readouterr()
    refused = f"use `{middleware}`, which `security {security}` does not allow: {why}"
    assert (refused in told.out + told.err) == bool(why)


def test_a_plug_in_that_connects_hosts_without_naming_an_address_needs_a_security_clause(
    net: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    install(net.parent / "packages", monkeypatch)
    body = NETWORK.replace(
        "Component sensor {{", 'host there {{ address "192.168.1.10"; }}; Component sensor {{ host there;'
    )
    net.write_text(body.format("local").replace("zeromq", "bare"))
    assert rc(["lint", str(net)]) == 1
    told = capsys.readouterr()
    refused = "`driver` and `sensor` are on different hosts, and `bare` connects them, which `security local` does not"
    assert refused in told.out + told.err
    net.write_text(body.format("open").replace("zeromq", "bare"))
    assert rc(["lint", str(net)]) == 0


def test_the_plan_of_a_network_without_keys_says_so_and_what_to_run(
    net: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert rcdeploy(["plan", str(net)]) == 0
    said = capsys.readouterr()
    assert "sensor" in said.out
    assert said.err.startswith("rcdeploy: warning: it cannot be started as it is: there are no keys in ")
    assert f"run: rcdeploy keys {net}" in said.err


def test_the_plan_names_the_folders_of_keys_and_no_secret(net: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert rcdeploy(["keys", str(net)]) == 0
    secrets = [path.read_text() for path in net.parent.rglob("*.key_secret")]
    capsys.readouterr()
    assert rcdeploy(["plan", str(net), "--json"]) == 0
    shown = capsys.readouterr().out
    assert len(secrets) == 2
    assert str(net.parent / "keys" / "Patrol" / "sensor") in shown
    assert not any(
        line.split('"')[1] in shown for text in secrets for line in text.splitlines() if "secret-key" in line
    )
