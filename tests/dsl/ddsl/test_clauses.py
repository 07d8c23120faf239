"""A row in the table of clauses is all that the tools need to know a clause."""

from __future__ import annotations

import re
from dataclasses import fields
from pathlib import Path

import pytest

from robocomp_py.dsl.ddsl import model as m
from robocomp_py.dsl.ddsl.clauses import CLAUSES, Block, ClauseType
from robocomp_py.dsl.format import format_text
from robocomp_py.lsp.complete import complete
from robocomp_py.lsp.hover import hover
from robocomp_py.lsp.index import Index
from robocomp_py.lsp.project import Project
from robocomp_py.lsp.tokens import colours

from ..texts import FOLDER, rendered, workspace

PAGE = Path(__file__).parents[3] / "docs" / "reference" / "languages" / "ddsl.md"
NETWORK = """Deployment net
{
    %(deployment)s
    host onboard { address "10.0.0.1"; };
    host spare { %(machine)s };
    System left { %(system)s };
    Component lidar { };
    Component driver { %(component)s };
};
"""
MODELS = {Block.NETWORK: m.Deployment, Block.SYSTEM: m.System, Block.INSTANCE: m.Instance, Block.HOST: m.Host}


PLACED = [pytest.param(each, block, id=f"{each.name}-{block}") for each in CLAUSES for block in each.where]


def network(clause: str, block: Block) -> str:
    return NETWORK % {**dict.fromkeys(map(str, Block), ""), str(block): clause}


@pytest.mark.parametrize(("clause", "block"), PLACED)
def test_every_clause_is_read_and_formatted_where_it_may_stand(clause: ClauseType, block: Block) -> None:
    found = workspace(**{"net.ddsl": network(clause.example, block)})
    model = found.deployment(FOLDER / "net.ddsl")
    assert model is not None
    assert [each.code for each in found.report.diagnostics if each.code == "syntax"] == [], rendered(found)
    assert clause.in_model in {each.name for each in fields(MODELS[block])}
    assert f" {clause.example}\n" in format_text(network(clause.example.replace(" ", "  ", 1), block), "ddsl")


@pytest.mark.parametrize(("clause", "block"), PLACED)
def test_an_editor_knows_every_clause(tmp_path: Path, clause: ClauseType, block: Block) -> None:
    """It completes its word where it may stand, and nowhere else, explains it, and colours it."""
    path, text = tmp_path / "net.ddsl", network(clause.example, block)
    path.write_text(text)
    index = Index(Project([tmp_path]))
    start = text.index(clause.example)
    word = re.match(r"\w+", clause.example)
    assert word is not None
    assert word[0] in {each.label for each in complete(index, path, text, start)}
    assert clause.doc in hover(index, path, start, text)
    [coloured] = [each for each in colours(index, path, text) if each.span.start == start]
    assert coloured.type == "keyword"
    for chosen in (*clause.choices, *clause.settings):
        if re.search(rf"\b{chosen}\b", clause.example):
            at = start + re.search(rf"\b{chosen}\b", clause.example).start()  # type: ignore[union-attr]  # found above
            assert {**clause.choices, **clause.settings}[chosen] in hover(index, path, at, text)


@pytest.mark.parametrize("clause", [each for each in CLAUSES if each.misplaced], ids=lambda each: each.name)
def test_a_clause_in_the_wrong_block_is_told_where_it_belongs(clause: ClauseType) -> None:
    wrong = Block.SYSTEM if Block.SYSTEM not in clause.where else Block.INSTANCE
    found = workspace(**{"net.ddsl": network(clause.example, wrong)})
    found.deployment(FOLDER / "net.ddsl")
    assert clause.misplaced in [each.hint for each in found.report.diagnostics]


def test_the_page_about_networks_has_every_clause() -> None:
    page = PAGE.read_text(encoding="utf-8")
    assert [each.name for each in CLAUSES if not re.search(rf"`[^`]*\b{each.explained[0]}\b[^`]*`", page)] == []
