"""Networks for systemd, compose and Kubernetes: read again as these do, and by their own schemas."""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import sys
from dataclasses import replace
from functools import cache
from importlib.util import find_spec
from pathlib import Path, PurePosixPath
from typing import Any

import jsonschema
import kubernetes_validate
import pytest
import yaml

from robocomp_py.cli import rcdeploy
from robocomp_py.deploy.exporters import EXPORTERS, Export, write_export
from robocomp_py.deploy.exporters.base import unique
from robocomp_py.deploy.keys import folder_of, make_keys
from robocomp_py.deploy.plan import Host, Plan, Process
from robocomp_py.deploy.policy import Escalation, Restart, When
from robocomp_py.deploy.relocation import places, relocate
from robocomp_py.deploy.security import secured
from robocomp_py.errors import DeploymentError
from robocomp_py.testing.patience import SOON
from robocomp_py.transports.ice.places import icestorm
from robocomp_py.transports.zenoh.deployment import router

from . import security_network

NASTY = [
    "plain",
    "",
    "two words",
    "quote \" and ' end",
    "back\\slash",
    "a\nExecStartPre=/bin/false",
    "tab\there",
    "100%h %% $HOME ${HOME} $(id) `id`",
    ";",
    "; rm -rf /",
    "# comment",
    "ünïcödé ☃",
    "---\nkey: value",
    "{{ template }}",
    "--",
    "yes",
    "0x10",
    "\u202e\x1b[31m",
]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("laser", "arm"):
        (tmp_path / name / "etc").mkdir(parents=True)
        (tmp_path / name / "__init__.py").touch()
        (tmp_path / name / "etc" / "config.toml").touch()
        (tmp_path / name / "__pycache__").mkdir()
    return tmp_path


def component(folder: Path, name: str, *more: str, **changed: Any) -> Process:
    command = (sys.executable, "-m", "robocomp_py.cli.rc", "run", str(folder / name), "--name", name, *more)
    made = Process(name, name.title(), command, folder, files=(folder / name,))
    return replace(made, **changed)


def network(*processes: Process, **changed: Any) -> Plan:
    return replace(Plan("Patrol", "zeromq", processes, ()), **changed)


def parts(text: str) -> dict[str, list[str]]:
    """The assignments of a unit; several of one name in their order."""
    found: dict[str, list[str]] = {}
    for line in text.splitlines():
        key, is_assignment, value = line.partition("=")
        if is_assignment and not line.startswith(("#", "[")):
            found.setdefault(key, []).append(value)
    return found


def only(export: Export, ending: str) -> str:
    (found,) = (text for name, text in export.files.items() if str(name).endswith(ending))
    return found


@cache
def compose_specification() -> Any:
    """A schema takes longer to read and check than a file by it."""
    package = find_spec("check_jsonschema")  # not imported: it takes long, and only its file is needed
    assert package is not None
    assert package.origin is not None
    schema = json.loads((Path(package.origin).parent / "builtin_schemas" / "vendor" / "compose-spec.json").read_text())
    validator = jsonschema.validators.validator_for(schema)
    validator.check_schema(schema)
    return validator(schema)


def compose_file(text: str) -> dict[str, Any]:
    """Read, and found to be right by the schema of the Compose Specification."""
    document = yaml.safe_load(text)
    compose_specification().validate(document)
    assert isinstance(document, dict)
    return document


def manifest(text: str) -> dict[str, Any]:
    document = yaml.safe_load(text)
    kubernetes_validate.validate(document, desired_version="1.31", strict=True)
    assert isinstance(document, dict)
    return document


# systemd


def test_a_process_becomes_a_service_of_the_network(folder: Path) -> None:
    arm = component(folder, "arm", after=("laser",), env={"GAIN": "3"}, restart=Restart(When.ON_FAILURE, 3, 30, 0.5))
    export = EXPORTERS["systemd"](network(component(folder, "laser"), arm), "net.ddsl")
    assert [str(name) for name in export.files] == [
        "robocomp-Patrol.target",
        "robocomp-Patrol-laser.service",
        "robocomp-Patrol-arm.service",
    ]
    unit = parts(only(export, "-arm.service"))
    assert unit["Type"] == ["notify"]
    assert unit["After"] == unit["Wants"] == ["robocomp-Patrol-laser.service"]
    assert unit["Environment"][1] == "GAIN=3"
    assert unit["Restart"] == ["on-failure"]
    assert (unit["StartLimitBurst"], unit["StartLimitIntervalSec"], unit["RestartSec"]) == (["3"], ["30"], ["0.5"])
    target = parts(only(export, ".target"))
    assert target["Wants"] == ["robocomp-Patrol-laser.service robocomp-Patrol-arm.service"]


def test_a_program_that_says_nothing_is_ready_once_it_runs(folder: Path) -> None:
    program = Process("lidar", "Lidar", ("urg_node",), folder, notifies=False, is_program=True)
    assert parts(only(EXPORTERS["systemd"](network(program), "net.ddsl"), ".service"))["Type"] == ["exec"]


def test_a_component_that_hangs_is_ended_as_by_rcdeploy_and_then_restart_counts(folder: Path) -> None:
    laser = component(folder, "laser", restart=Restart(When.ON_FAILURE))
    unit = parts(only(EXPORTERS["systemd"](network(laser), "net.ddsl"), ".service"))
    assert (unit["WatchdogSec"], unit["TimeoutAbortSec"], unit["Restart"]) == (["30"], ["5"], ["on-failure"])


def test_what_feeds_no_watchdog_is_not_ended_for_that(folder: Path) -> None:
    program = Process("lidar", "Lidar", ("urg_node",), folder, is_program=True)
    plan = network(
        program,
        helpers=(router("", {"connect": "here/Patrol"}), icestorm("S:tcp -p 9999"), icestorm("S:tcp -p 9998", 1)),
    )
    units = [text for name, text in EXPORTERS["systemd"](plan, "n").files.items() if name.suffix == ".service"]
    assert len(units) == 4
    assert not any("WatchdogSec" in parts(text) for text in units)


def test_no_grace_at_all_is_not_for_ever(folder: Path) -> None:
    unit = parts(only(EXPORTERS["systemd"](network(component(folder, "laser", grace=0)), "net.ddsl"), ".service"))
    assert float(unit["TimeoutStopSec"][0]) > 0


def test_a_program_that_says_so_is_ready_when_it_says_so(folder: Path) -> None:
    program = Process("lidar", "Lidar", ("urg_node",), folder, is_program=True)
    export = EXPORTERS["systemd"](network(program), "net.ddsl")
    assert parts(only(export, ".service"))["Type"] == ["notify"]
    assert export.notes == ()


def test_units_of_other_hosts_go_with_their_components(folder: Path) -> None:
    host = Host("onboard", "192.168.1.10", "robot", python="python3.12")
    plan = network(component(folder, "laser", host="onboard"), component(folder, "arm"), hosts=(host,))
    export = EXPORTERS["systemd"](plan, "net.ddsl")
    assert PurePosixPath("localhost/robocomp-Patrol-arm.service") in export.files
    assert export.copies == {PurePosixPath("onboard/app/laser"): folder / "laser"}
    unit = parts(only(export, "-laser.service"))
    assert unit["ExecStart"][0].startswith(
        'python3.12 -m robocomp_py.cli.rc run "%h/robocomp-Patrol/app/laser" --name laser'
    )
    assert export.steps[0].startswith("tar --create --directory onboard . | ssh robot@192.168.1.10 ")


def test_a_host_with_a_port_of_its_own_is_reached_there(folder: Path) -> None:
    host = Host("onboard", "192.168.1.10", port=2222)
    export = EXPORTERS["systemd"](network(component(folder, "laser", host="onboard"), hosts=(host,)), "net.ddsl")
    assert all("ssh -p 2222 192.168.1.10 " in step for step in export.steps)


SSH = """\
#!/bin/sh
# Like ssh: joins the words that follow the host with spaces, and has the shell of that host split them again.
while [ "$1" != robot@192.168.1.10 ]; do shift; done
shift
cd "$REMOTE" && exec sh -c "$*"
"""


@pytest.mark.parametrize("name", ["plain", "with spaces", "a;touch X;$(touch Y)`touch Z`", 'it\'s \\ "q" * ?', "~"])
def test_the_steps_work_with_any_folder_of_a_host(tmp_path: Path, folder: Path, name: str) -> None:
    home, programs = tmp_path / "home", tmp_path / "bin"
    home.mkdir()
    programs.mkdir()
    for program, text in (("ssh", SSH), ("systemctl", '#!/bin/sh\necho "$@" > enabled\n')):
        (programs / program).write_text(text)
        (programs / program).chmod(0o755)
    host = Host("onboard", "192.168.1.10", "robot", 2222, workdir=str(tmp_path / "there" / name))
    export = EXPORTERS["systemd"](network(component(folder, "laser", host="onboard"), hosts=(host,)), "net.ddsl")
    write_export(export, tmp_path / "out")
    environment = {"PATH": f"{programs}:{os.environ['PATH']}", "REMOTE": str(home)}
    for step in export.steps:
        subprocess.run(["sh", "-c", step], cwd=tmp_path / "out", env=environment, check=True, timeout=SOON * 6)
    assert [each.name for each in (tmp_path / "there").iterdir()] == [name]
    assert (tmp_path / "there" / name / "app" / "laser").is_dir()
    units = {each.name for each in (home / ".config" / "systemd" / "user").iterdir()}
    assert units == {"robocomp-Patrol.target", "robocomp-Patrol-laser.service"}
    assert (home / "enabled").read_text() == "--user enable --now robocomp-Patrol.target\n"
    assert {each.name for each in home.iterdir()} == {".config", "enabled"}


def test_where_the_network_says_is_where_units_look(folder: Path) -> None:
    host = Host("onboard", "192.168.1.10", workdir="/srv/100% mine")
    export = EXPORTERS["systemd"](network(component(folder, "laser", host="onboard"), hosts=(host,)), "net.ddsl")
    unit = parts(only(export, ".service"))
    assert '"/srv/100%% mine/app/laser"' in unit["ExecStart"][0]
    assert unit["WorkingDirectory"] == ["/srv/100%% mine"]


def test_a_folder_that_systemd_cannot_name_is_refused(folder: Path) -> None:
    plan = network(component(folder, "laser", cwd=Path("/tmp/a\nExecStartPre=/bin/false")))
    with pytest.raises(DeploymentError, match="rename it"):
        EXPORTERS["systemd"](plan, "net.ddsl")


def systemd_words(line: str) -> list[str]:
    """What systemd.syntax(7) makes of a command line, without variables and specifiers in it."""
    assert "%" not in line.replace("%%", "")
    assert "$" not in line.replace("$$", "")
    words, at = [], 0
    while at < len(line):
        if line[at] == " ":
            at += 1
            continue
        word, quoted = bytearray(), line[at] == '"'
        at += quoted
        while at < len(line) and line[at] != ('"' if quoted else " "):
            if line[at] == "\\" and line[at + 1] == "x":
                word.append(int(line[at + 2 : at + 4], 16))
                at += 4
                continue
            at += line[at] == "\\"
            word += line[at].encode()
            at += 1
        at += quoted
        words.append(word.decode().replace("%%", "%").replace("$$", "$"))
    return words


@pytest.mark.parametrize("text", NASTY)
def test_systemd_reads_what_was_meant(folder: Path, text: str) -> None:
    process = component(folder, "laser", text, env={"TEXT": text})
    unit = parts(only(EXPORTERS["systemd"](network(process), f"{text}.ddsl"), ".service"))
    assert systemd_words(unit["ExecStart"][0])[-1] == text
    (given,) = (line for line in unit["Environment"] if "TEXT=" in line)
    assert systemd_words(given.replace("$", "$$")) == [f"TEXT={text}"]
    assert "ExecStartPre" not in unit


@pytest.mark.tool
@pytest.mark.parametrize("text", NASTY)
def test_systemd_accepts_units(folder: Path, tmp_path: Path, text: str) -> None:
    arm = component(folder, "arm", text, after=("laser",), env={"TEXT": text}, restart=Restart(When.ALWAYS))
    export = EXPORTERS["systemd"](network(component(folder, "laser"), arm), "net.ddsl")
    write_export(export, tmp_path / "units")
    units = sorted(str(path) for path in (tmp_path / "units").iterdir())
    ran = subprocess.run(["systemd-analyze", "verify", *units], capture_output=True, text=True, timeout=SOON * 6)
    assert (ran.returncode, ran.stderr) == (0, "")


# compose


def test_a_process_becomes_a_service_of_compose(folder: Path) -> None:
    arm = component(folder, "arm", after=("laser",), env={"GAIN": "3"}, restart=Restart(When.ON_FAILURE, 3), grace=7)
    document = compose_file(only(EXPORTERS["compose"](network(component(folder, "laser"), arm), "n"), "compose.yaml"))
    service = document["services"]["arm"]
    assert service["command"] == ["python", "-m", "robocomp_py.cli.rc", "run", "/app/arm", "--name", "arm"]
    assert service["depends_on"] == {"laser": {"condition": "service_healthy"}}
    assert service["restart"] == "on-failure:3"
    assert service["stop_grace_period"] == "7s"
    assert service["environment"]["GAIN"] == "3"
    assert document["services"]["laser"]["restart"] == "no"


def test_only_processes_that_report_readiness_are_waited_for(folder: Path) -> None:
    program = Process("lidar", "Lidar", ("urg_node",), folder, notifies=False, is_program=True)
    export = EXPORTERS["compose"](network(program, component(folder, "arm", after=("lidar",))), "n")
    document = compose_file(only(export, "compose.yaml"))
    assert document["services"]["arm"]["depends_on"] == {"lidar": {"condition": "service_started"}}
    assert "healthcheck" not in document["services"]["lidar"]
    assert "`lidar` runs `urg_node`: add what installs it to the Dockerfile" in export.notes


def test_containers_are_not_asked_for_a_file_that_only_components_of_ours_make(folder: Path) -> None:
    program = Process("lidar", "Lidar", ("urg_node",), folder, is_program=True)
    plan = network(program, component(folder, "arm", after=("lidar",)))
    composed, cluster = EXPORTERS["compose"](plan, "n"), EXPORTERS["kubernetes"](plan, "n")
    services = compose_file(only(composed, "compose.yaml"))["services"]
    assert services["arm"]["depends_on"] == {"lidar": {"condition": "service_started"}}
    assert "healthcheck" not in services["lidar"]
    lidar, arm = manifest(only(cluster, ".yaml"))["spec"]["template"]["spec"]["containers"]
    assert ("readinessProbe" in lidar, "readinessProbe" in arm) == (False, True)
    for export in (composed, cluster):
        assert any("ignores sd_notify: `notifies` of lidar has no effect" in note for note in export.notes)
        assert "`lidar` runs `urg_node`: add what installs it to the Dockerfile" in export.notes


@pytest.mark.parametrize("text", NASTY)
def test_compose_reads_what_was_meant(folder: Path, text: str) -> None:
    export = EXPORTERS["compose"](network(component(folder, "laser", text, env={"TEXT": text})), f"{text}.ddsl")
    service = compose_file(only(export, "compose.yaml"))["services"]["laser"]
    assert service["command"][-1].replace("$$", "$") == text
    assert service["environment"]["TEXT"].replace("$$", "$") == text
    assert "$" not in service["command"][-1].replace("$$", "")


def test_each_machine_has_a_compose_file_of_its_own(folder: Path) -> None:
    plan = network(
        component(folder, "laser", host="onboard"), component(folder, "arm"), hosts=(Host("onboard", "10.0.0.2"),)
    )
    export = EXPORTERS["compose"](plan, "n")
    assert {str(name) for name in export.files} == {
        f"{host}/{file}" for host in ("onboard", "localhost") for file in ("compose.yaml", "Dockerfile")
    }


# Kubernetes


def test_a_machine_becomes_a_pod_with_a_container_for_each_process(folder: Path) -> None:
    plan = network(component(folder, "laser"), component(folder, "arm", env={"GAIN": "3"}, grace=9))
    pod = manifest(only(EXPORTERS["kubernetes"](plan, "n"), ".yaml"))["spec"]["template"]["spec"]
    laser, arm = pod["containers"]
    assert (laser["name"], arm["name"]) == ("laser", "arm")
    assert arm["command"][:5] == ["python", "-m", "robocomp_py.cli.rc", "run", "/app/arm"]
    assert {"name": "GAIN", "value": "3"} in arm["env"]
    assert pod["terminationGracePeriodSeconds"] == 9


def test_a_pod_runs_on_the_host_of_its_processes(folder: Path) -> None:
    plan = network(component(folder, "laser", host="onboard"), hosts=(Host("onboard", "10.0.0.2"),))
    pod = manifest(only(EXPORTERS["kubernetes"](plan, "n"), ".yaml"))["spec"]["template"]["spec"]
    assert pod["nodeSelector"] == {"kubernetes.io/hostname": "onboard"}


@pytest.mark.parametrize("text", NASTY)
def test_kubernetes_reads_what_was_meant(folder: Path, text: str) -> None:
    plan = network(component(folder, "laser", text, env={"TEXT": text}))
    pod = manifest(only(EXPORTERS["kubernetes"](plan, f"{text}.ddsl"), ".yaml"))["spec"]["template"]["spec"]
    (container,) = pod["containers"]
    assert container["command"][-1].replace("$$(", "$(") == text
    assert {"name": "TEXT", "value": text.replace("$(", "$$(")} in container["env"]


def test_what_an_engine_does_not_do_is_said(folder: Path) -> None:
    plan = network(
        component(folder, "laser"),
        component(folder, "arm", after=("laser",), restart=Restart(When.ALWAYS)),
        escalations={(): Escalation.ONE_FOR_ALL},
    )
    for export in (exporter(plan, "n") for exporter in EXPORTERS.values()):
        assert any("`escalation` has no effect" in note for note in export.notes)
    for kind in EXPORTERS:
        is_said = any("a component that hangs" in note for note in EXPORTERS[kind](plan, "n").notes)
        assert is_said is (kind != "systemd")
    assert any("also laser" in note for note in EXPORTERS["kubernetes"](plan, "n").notes)
    assert any("`dependences` of arm" in note for note in EXPORTERS["kubernetes"](plan, "n").notes)


# What they share


def test_names_become_different_ones() -> None:
    assert unique(["left/arm", "left-arm", "left arm", "☃"], "a-z") == {
        "left/arm": "left-arm",
        "left-arm": "left-arm-2",
        "left arm": "left-arm-3",
        "☃": "x",
    }
    assert unique(["Laser", "laser"], "a-z", str.lower) == {"Laser": "laser", "laser": "laser-2"}


def test_files_keep_their_names_where_these_are_free(tmp_path: Path) -> None:
    one, other = tmp_path / "one" / "laser", tmp_path / "other" / "laser"
    process = replace(component(tmp_path, "laser"), files=(one, other, one / "etc" / "config.toml"))
    moved = places([process], "/app")
    assert moved == {
        one: "/app/laser",
        other: "/app/laser2",
        one / "etc" / "config.toml": "/app/laser/etc/config.toml",
    }
    changed = replace(process, command=(sys.executable, "run", str(one), "--set", f"params.x={one}"))
    assert relocate(changed, moved, "python") == ("python", "run", "/app/laser", "--set", f"params.x={one}")
    assert relocate(replace(changed, is_program=True), moved, "python")[:2] == (sys.executable, "run")


@pytest.mark.parametrize("kind", EXPORTERS)
def test_an_export_is_written_again_over_itself(folder: Path, tmp_path: Path, kind: str) -> None:
    plan = network(component(folder, "laser"))
    for _ in range(2):
        write_export(EXPORTERS[kind](plan, "net.ddsl"), tmp_path / "out")
    assert not (tmp_path / "out" / "app" / "laser" / "__pycache__").exists()
    assert not list((tmp_path / "out").glob(".export-*"))


def test_what_was_not_made_here_stays(folder: Path, tmp_path: Path) -> None:
    export = EXPORTERS["compose"](network(component(folder, "laser")), "net.ddsl")
    mine = tmp_path / "out" / "Dockerfile"
    mine.parent.mkdir()
    mine.write_text("FROM scratch\n")
    with pytest.raises(DeploymentError, match="Dockerfile was not made by rcdeploy; move it away"):
        write_export(export, tmp_path / "out")
    assert [path.name for path in mine.parent.iterdir()] == ["Dockerfile"]
    mine.unlink()
    (tmp_path / "out" / "app").mkdir()
    with pytest.raises(DeploymentError, match="app was not made by rcdeploy"):
        write_export(export, tmp_path / "out")


def test_the_image_holds_what_the_commands_name(folder: Path, tmp_path: Path) -> None:
    export = EXPORTERS["compose"](network(component(folder, "laser")), "net.ddsl")
    write_export(export, tmp_path / "out")
    assert (tmp_path / "out" / "app" / "laser" / "etc" / "config.toml").is_file()


@pytest.mark.parametrize("kind", EXPORTERS)
def test_the_command_exports_a_network(tmp_path: Path, kind: str, capsys: pytest.CaptureFixture[str]) -> None:
    network = Path(__file__).parents[2] / "components" / "rescue.ddsl"
    assert rcdeploy.main(["export", kind, str(network), "-o", str(tmp_path / "out")]) == 0
    printed = capsys.readouterr().out
    assert all(path.name in printed for path in (tmp_path / "out").iterdir() if path.name != "app")
    assert rcdeploy.main(["export", kind, str(network), "-o", str(network)]) == 1
    assert "is a file; give a folder by -o" in capsys.readouterr().err


@pytest.mark.parametrize("kind", EXPORTERS)
def test_what_carries_messages_to_other_hosts_is_started_first(folder: Path, kind: str) -> None:
    plan = network(
        component(folder, "laser", host="onboard"),
        hosts=(Host("onboard", "10.0.0.2"),),
        helpers=(router("onboard", {"connect": "here/Patrol", "router": {"mode": "router"}}),),
    )
    text = "".join(EXPORTERS[kind](plan, "n").files.values())
    assert text.index("zenoh-router") < text.index("laser")
    assert "transports.zenoh.connect=" in text
    assert "here/Patrol" in text


def test_icestorm_starts_before_publishers_over_ice(folder: Path) -> None:
    proxy = "IceStorm/TopicManager:tcp -h 127.0.0.1 -p 9999"
    plan = network(component(folder, "laser"), helpers=(icestorm(proxy),))
    export = EXPORTERS["systemd"](plan, "n")
    assert parts(only(export, "-laser.service"))["After"] == ["robocomp-Patrol-ice-storm.service"]
    assert "transports.ice.storm" in only(export, "-ice-storm.service")


def test_a_router_is_there_before_its_components(folder: Path) -> None:
    plan = network(component(folder, "laser"), helpers=(router("", {"connect": "here/Patrol"}),))
    unit = parts(only(EXPORTERS["systemd"](plan, "n"), "-laser.service"))
    assert unit["After"] == ["robocomp-Patrol-zenoh-router.service"]
    services = compose_file(only(EXPORTERS["compose"](plan, "n"), "compose.yaml"))["services"]
    assert services["laser"]["depends_on"] == {"zenoh-router": {"condition": "service_healthy"}}


@pytest.fixture
def guarded(folder: Path) -> Plan:
    """A network on one other host whose process and router have keys."""
    keys = folder / "keys" / "laser"
    own = folder / "keys" / "router@onboard"
    for each in (keys, own):
        each.mkdir(parents=True)
        (each / "key.pem").touch(0o600)
    laser = component(folder, "laser", "--keys", str(keys), host="onboard", files=(folder / "laser", keys))
    settings = {"transport/link/tls/listen_private_key": str(own / "key.pem"), "access_control": {"enabled": True}}
    helper = replace(router("onboard", {"connect": "here/Patrol", "router": settings}), keys=str(own))
    return network(laser, hosts=(Host("onboard", "10.0.0.2", "robot"),), helpers=(helper,))


def test_units_get_the_keys_of_their_processes_beside_their_components(guarded: Plan, folder: Path) -> None:
    export = EXPORTERS["systemd"](guarded, "n")
    assert export.copies == {
        PurePosixPath("app/laser"): folder / "laser",
        PurePosixPath("keys/laser"): folder / "keys" / "laser",
        PurePosixPath("keys/router@onboard"): folder / "keys" / "router@onboard",
    }
    assert '--keys "%h/robocomp-Patrol/keys/laser"' in parts(only(export, "-laser.service"))["ExecStart"][0]
    assert '"%h/robocomp-Patrol/keys/router@onboard/key.pem' in only(export, "-zenoh-router.service").replace("\\", "")
    assert str(folder) not in "".join(export.files.values())


def test_keys_are_mounted_into_containers_and_not_into_their_image(guarded: Plan) -> None:
    export = EXPORTERS["compose"](guarded, "n")
    services = compose_file(only(export, "compose.yaml"))["services"]
    assert "./keys/laser:/keys/laser:ro" in services["laser"]["volumes"]
    assert "./keys/router@onboard:/keys/router@onboard:ro" in services["zenoh-router"]["volumes"]
    assert only(export, ".dockerignore").splitlines()[1:] == ["keys"]
    assert "keys" not in only(export, "Dockerfile")


def test_keys_become_secrets_of_kubernetes(guarded: Plan) -> None:
    export = EXPORTERS["kubernetes"](guarded, "n")
    pod = manifest(only(export, ".yaml"))["spec"]["template"]["spec"]
    laser = next(each for each in pod["containers"] if each["name"] == "laser")
    assert {"name": "keys-laser", "mountPath": "/keys/laser", "readOnly": True} in laser["volumeMounts"]
    secret = next(each["secret"] for each in pod["volumes"] if each["name"] == "keys-laser")
    assert (secret["secretName"], secret["defaultMode"]) == ("patrol-laser", 0o440)
    assert any(step.startswith("kubectl create secret generic patrol-laser --from-file=") for step in export.steps)


def tree(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_in_a_pod_there_are_the_same_keys_as_here(tmp_path: Path) -> None:
    plan = security_network.network(
        security_network.way("left/arm", "camera", "divide"),
        security_network.way("camera", "left/arm", "news"),
        names=("camera", "left/arm"),
        router="tls/10.0.0.1:7447",
    )
    make_keys(plan, tmp_path / "keys", security_network.NOW)
    export = EXPORTERS["kubernetes"](secured(plan, tmp_path / "keys"), "n")
    write_export(export, tmp_path / "out")
    volumes = manifest(only(export, ".yaml"))["spec"]["template"]["spec"]["volumes"]
    mounted = {each["secret"]["secretName"]: each["secret"]["items"] for each in volumes if "secret" in each}
    found: dict[str, dict[str, bytes]] = {}
    for step in export.steps:  # as kubectl does
        match shlex.split(step):
            case ["kubectl", "create", "secret", "generic", name, *options]:
                files = dict(each.removeprefix("--from-file=").split("=") for each in options if "--from-file" in each)
                assert all(re.fullmatch(r"[-._a-zA-Z0-9]+", key) for key in files)
                data = {key: (tmp_path / "out" / path).read_bytes() for key, path in files.items()}
                found[name] = {item["path"]: data[item["key"]] for item in mounted[name]}
    assert found == {
        "patrol-camera": tree(folder_of(tmp_path / "keys", "camera")),
        "patrol-left-arm": tree(folder_of(tmp_path / "keys", "left/arm")),
        "patrol-zenoh-router": tree(tmp_path / "keys" / "router@"),
    }
    assert "admitted/left.arm.key" in found["patrol-camera"]


def test_kubernetes_gets_no_keys_that_rcdeploy_did_not_make(folder: Path) -> None:
    plan = network(component(folder, "laser", "--keys", str(folder / "mine")))
    with pytest.raises(DeploymentError, match="write `security lan;`"):
        EXPORTERS["kubernetes"](plan, "n")


@pytest.mark.parametrize("kind", EXPORTERS)
def test_what_a_program_of_another_kind_calls_keys_is_its_own_affair(folder: Path, kind: str) -> None:
    program = Process("lidar", "Lidar", ("urg_node", "--keys", "/etc/lidar"), folder, notifies=False, is_program=True)
    assert EXPORTERS[kind](network(program), "n").copies == {}


def test_copied_keys_stay_readable_for_their_user_only(guarded: Plan, tmp_path: Path) -> None:
    write_export(EXPORTERS["systemd"](guarded, "n"), tmp_path / "out")
    assert (tmp_path / "out" / "keys" / "laser" / "key.pem").stat().st_mode & 0o077 == 0
