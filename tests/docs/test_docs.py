"""What the documentation says is so: its commands are run, its files are used, its examples are checked."""

from __future__ import annotations

import re
import shutil
import tomllib
from pathlib import Path
from typing import Any

import pytest

from robocomp_py import installed
from robocomp_py.contract.interface import Verb
from robocomp_py.contract.parameters import check
from robocomp_py.contract.qos import QoS, Reliability
from robocomp_py.dsl.workspace import Workspace
from robocomp_py.errors import ConfigurationError
from robocomp_py.runtime import settings
from robocomp_py.runtime.lifecycle import State
from robocomp_py.runtime.RoboCompCommonBehavior import COMMONBEHAVIOR_INTERFACE
from robocomp_py.runtime.settings import LOG_LEVELS
from robocomp_py.runtime.worker import HOOKS, Worker
from robocomp_py.transports import iceoptions
from robocomp_py.transports.base import TransportConfig, find_transport
from robocomp_py.transports.iceoptions import IceOptions
from robocomp_py.transports.network import Network, Site, Way

from .pages import DOCS, ROOT, Command, File, blocks, steps
from .reader import do

LANGUAGES = ("idsl", "cdsl", "pdsl", "ddsl", "smdsl")


def test_the_picture_of_the_example_network_is_as_it_would_be_drawn(tmp_path: Path) -> None:
    do(Command(f"rc graph {ROOT}/components/rescue.ddsl -o network.svg"), tmp_path)
    assert (DOCS / "images" / "network.svg").read_text() == (tmp_path / "network.svg").read_text(), "draw it again"


MIDDLEWARES = DOCS / "reference" / "middlewares.md"


def read_ice(config: TransportConfig) -> IceOptions:
    return iceoptions.read(config.options)


def test_every_middleware_and_all_its_options_are_explained() -> None:
    page = MIDDLEWARES.read_text(encoding="utf-8")
    explained = dict.fromkeys(re.findall(r"^\| `(\w+)` \|", page, re.MULTILINE), "")
    for name, option in re.findall(r"^\| `(\w+)`: `(\w+)` \|", page, re.MULTILINE):
        explained[name] = f"{explained[name]}, {option}".removeprefix(", ")
    assert set(explained) == set(installed.transports())
    for name, options in explained.items():
        opened = read_ice if name == "ice" else find_transport(name)  # which need not be installed
        with pytest.raises(ConfigurationError, match=f"known: {options or 'none'}$"):
            opened(TransportConfig({"nonsense": 1}))


def test_the_choices_by_port_and_operation_are_a_configuration(tmp_path: Path) -> None:
    toml, _, _ = blocks(MIDDLEWARES, "toml")
    config, cdsl = tmp_path / "config.toml", tmp_path / "arm.cdsl"
    config.write_text(toml)
    cdsl.write_text(
        'import "Laser.idsl"; Component arm { language python; Communications { requires Laser(zenoh); }; };'
    )
    linked = Workspace().component(cdsl)
    assert linked is not None
    [port] = linked.component.ports
    chosen = settings.check(linked.component, settings.read(config))
    routes = [chosen.port(port, operation).middleware for operation in ("getLaserData", "getLaserConfData")]
    assert (port.middleware, chosen.middleware, routes) == ("zenoh", "zeromq", ["zenoh", "dds"])


def test_several_ways_to_a_port_are_a_configuration(tmp_path: Path) -> None:
    _, toml, _ = blocks(MIDDLEWARES, "toml")
    config, cdsl = tmp_path / "config.toml", tmp_path / "arm.cdsl"
    config.write_text(toml)
    ports = "publishes CameraSimplePub; subscribesTo LaserPub;"
    cdsl.write_text(
        f'import "CameraSimplePub.idsl"; import "LaserPub.idsl"; Component arm {{ Communications {{ {ports} }}; }};'
    )
    linked = Workspace().component(cdsl)
    assert linked is not None
    chosen = settings.check(linked.component, settings.read(config))
    routes = [chosen.middlewares(port, "", "zeromq") for port in linked.component.ports]
    assert routes == [["zeromq", "inproc", "shm"], ["shm", "zeromq"]]


def test_what_is_found_over_ice_is_a_configuration(tmp_path: Path) -> None:
    *_, toml = blocks(MIDDLEWARES, "toml")
    config, cdsl = tmp_path / "config.toml", tmp_path / "arm.cdsl"
    config.write_text(toml)
    ports = "requires Laser(ice), Laser(ice), Speech(ice); implements Speech(ice);"
    cdsl.write_text(f'import "Laser.idsl"; import "Speech.idsl"; Component arm {{ Communications {{ {ports} }}; }};')
    linked = Workspace().component(cdsl)
    assert linked is not None
    document = settings.read_for(config, linked.component)
    settings.settle(document, linked.component, "zeromq")
    chosen = settings.check(linked.component, document)
    assert [chosen.port(port, "").source for port in linked.component.ports[:3]] == ["base", "laser1", "base"]


TRANSPORTS = DOCS / "guides" / "transports.md"


@pytest.mark.tool  # needs nothing but time
def test_the_smallest_transport_of_the_guide_keeps_the_contract(tmp_path: Path) -> None:
    for step in steps(TRANSPORTS):
        if isinstance(step, File):
            do(step, tmp_path)
    do(Command("python -m pytest --quiet test_counting.py", ["...", "...passed in ..."]), tmp_path)


def test_the_transport_over_tcp_of_the_guide_is_the_tested_one() -> None:
    (shown,) = (step.text for step in steps(TRANSPORTS) if isinstance(step, File) and step.path == "tcp.py")
    assert shown == (ROOT / "tests" / "transports" / "tcp.py").read_text()


def test_the_deployment_side_of_the_guide_connects_hosts() -> None:
    (shown,) = (step.text for step in steps(TRANSPORTS) if isinstance(step, File) and step.path == "tcp_hosts.py")
    names: dict[str, Any] = {"__name__": "tcp_hosts"}
    exec(shown, names)
    way = Way("map", "laser", "laser", Verb.REQUIRES, "Laser", "get", "tcp", "")
    sites = [Site("laser", "laser", "robot"), Site("map", "map"), Site("alone", "alone")]
    network = Network("N", {"": "10.0.0.1", "robot": "10.0.0.2"}, sites, [way], middleware="tcp")
    side = names["TcpDeployment"]()
    wiring = side.wire(network)
    assert wiring.options == {"laser": {"host": "10.0.0.2"}, "map": {"host": "10.0.0.1"}}
    here, there = (f"{address}:{network.helper_port}" for address in network.addresses.values())
    assert {each.host: each.options["copy"] for each in wiring.helpers} == {
        "": {"listen": here, "from": [there]},
        "robot": {"listen": there, "from": [here]},
    }
    assert [each.address for each in side.reached(wiring.helpers[0].options)] == [f"tcp://{here}"]


@pytest.mark.tool  # needs nothing but time, to build and install it: `make test-tools` has more of it
def test_the_transport_that_is_a_package_of_its_own_is_found_keeps_the_contract_and_carries_a_network(
    tmp_path: Path,
) -> None:
    for name in ("components", "examples"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__"))
    installed = str(tmp_path / "installed")  # not among the packages of this environment
    offline = {"PIP_NO_INDEX": "1", "PIP_NO_DEPS": "1", "PIP_NO_BUILD_ISOLATION": "false"}  # false means: without
    written = _written(tmp_path / "components")
    commands = [step for step in steps(TRANSPORTS) if isinstance(step, Command)]
    assert len(commands) == 3
    for command in commands:
        do(command, tmp_path, PYTHONPATH=installed, PIP_TARGET=installed, **offline)
    assert _written(tmp_path / "components") == written


def _written(folder: Path) -> dict[Path, bytes]:
    """What is not generated, of all components."""
    files = (path for path in folder.rglob("*") if path.is_file() and not {"generic", "__pycache__"} & {*path.parts})
    return {path: path.read_bytes() for path in files}


def test_each_decision_has_a_number_of_its_own() -> None:
    pages = sorted((DOCS / "decisions").glob("[0-9]*.md"))
    assert len({page.name[:3] for page in pages}) == len(pages)
    for page in pages:
        assert re.match(rf"# 0*{int(page.name[:3])}\.? ", page.read_text(encoding="utf-8")), page.name


@pytest.mark.parametrize("language", LANGUAGES)
def test_examples_in_the_language_reference_are_right(language: str) -> None:
    page = DOCS / "reference" / "languages" / f"{language}.md"
    texts = {f"example{n}.{kind}": text for kind in LANGUAGES for n, text in enumerate(blocks(page, kind))}
    assert texts
    for name in texts:
        workspace = Workspace(read=lambda path: _read(path, texts))
        workspace.check(ROOT / "components" / name)  # where its imports would be found
        missing = [each for each in workspace.report.errors if each.code not in ("missing-file",)]
        assert not missing, [each.render() for each in missing]


def _read(path: Path, texts: dict[str, str]) -> bytes:
    return texts[path.name].encode() if path.name in texts else path.read_bytes()


def test_the_configuration_in_the_reference_fits_its_parameters() -> None:
    page = DOCS / "reference" / "languages" / "pdsl.md"
    (pdsl,), (toml,) = blocks(page, "pdsl"), blocks(page, "toml")
    spec = Workspace(read=lambda _: pdsl.encode()).parameters(Path("explorer.pdsl"))
    assert spec is not None
    assert check(spec, tomllib.loads(toml)["params"])[1] == []


COMPONENTS = DOCS / "reference" / "components.md"


def test_everything_that_a_worker_has_is_explained() -> None:
    page = COMPONENTS.read_text(encoding="utf-8")
    there = [name for name in (*vars(Worker), *Worker.__annotations__) if not name.startswith("_")]
    offered = [operation.name for operation in COMMONBEHAVIOR_INTERFACE.operations]
    words = [*there, *HOOKS, *State, *offered, *LOG_LEVELS]
    assert {"stop", "period", "goToEmergency", "killYourSelf"} <= set(words)
    assert not [word for word in words if not re.search(rf"\b{word}\b", page)]


def test_the_configuration_that_is_explained_is_one(tmp_path: Path) -> None:
    [toml] = blocks(COMPONENTS, "toml")
    cdsl = tmp_path / "arm.cdsl"
    cdsl.write_text(
        'import "Laser.idsl"; import "LaserPub.idsl"; Component arm { language python; params "arm.pdsl";'
        " timer poll 1 s; Communications { requires Laser; implements Laser; subscribesTo LaserPub;"
        " publishes LaserPub each; }; };"
    )
    (tmp_path / "arm.pdsl").write_text("ComponentParams arm { max_speed float 1 0:2; };")
    linked = Workspace().component(cdsl)
    assert linked is not None
    given = settings.check(linked.component, settings.Document(tomllib.loads(toml)))
    proxy, handlers, topic, named = linked.component.ports
    assert given.port(proxy, "getLaserData").deadline == 0.1
    assert given.port(proxy, "getLaserConfData").deadline == 0.5
    assert given.port(handlers, "getLaserData").middleware == "inproc"
    assert given.port(topic, "pushLaserData").qos == QoS(Reliability.RELIABLE, depth=1)
    assert given.port(named, "pushLaserData", "front").middleware == "shm"
    assert (given.period, given.timers, given.params) == (0.05, {"poll": 0.02}, {"max_speed": 0.5})


def test_links_between_pages_lead_somewhere() -> None:
    for page in [ROOT / "README.md", *DOCS.rglob("*.md")]:
        for target in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
            if "://" not in target:
                there = (page.parent / target).resolve()
                assert there.exists(), f"{page.name}: {target}"
                if DOCS in page.parents and there.suffix == ".md":  # the site has the pages in `docs` and the README
                    assert DOCS in there.parents or there == ROOT / "README.md", f"{page.name}: {target}"


def test_every_page_is_listed_under_its_kind() -> None:
    listed = set(re.findall(r"\]\(([^)]+\.md)\)", (DOCS / "README.md").read_text(encoding="utf-8")))
    kinds = ("tutorials", "guides", "reference", "explanation")
    assert {str(page.relative_to(DOCS)) for kind in kinds for page in (DOCS / kind).rglob("*.md")} <= listed
