"""Parts that each page has, and the places that pages and code name."""

import re
from pathlib import Path

import pytest

GENERATED = {
    "stress.md",
    "verification.md",
    "benchmarks/commands.md",
    "benchmarks/error_bars.md",
    "benchmarks/gpu.md",
    "benchmarks/one_answer.md",
    "benchmarks/peak_maps.md",
    "benchmarks/error_factors.md",
    "benchmarks/published.md",
    "benchmarks/skip.md",
    "benchmarks/work_precision.md",
    "validation/avakot.md",
    "validation/cascades_2021.md",
    "validation/columns.md",
    "validation/coulomb_only.md",
    "validation/flume.md",
    "validation/frank_slide.md",
    "validation/idealized_topo.md",
}
PARTS_OF_A_DECISION = ("**What", "**Why", "**Evidence", "**Cost", "**What would overturn it.**")
HASH = re.compile(r"\b(?=[0-9a-f]*[0-9])(?=[0-9a-f]*[a-f])[0-9a-f]{7,40}\b")
LINK = re.compile(r"\]\(([^)\s]+)\)")
DOC_ROLE = re.compile(r"\{doc\}`(?:[^`<]*<)?([^`>]+)>?`")
PATH_IN_CODE = re.compile(r"\bdocs/[\w./-]+\.(?:md|json|png|py)\b")


@pytest.fixture(scope="module")
def docs(repository) -> Path:
    return repository / "docs"


@pytest.fixture(scope="module")
def pages(docs) -> dict[str, str]:
    """Text of every page by its path."""
    found = sorted(p for p in docs.rglob("*.md") if "_build" not in p.parts)
    return {p.relative_to(docs).as_posix(): p.read_text(encoding="utf-8") for p in found}


@pytest.fixture(scope="module")
def decisions(pages) -> dict[str, str]:
    return {name: text for name, text in pages.items() if re.match(r"decisions/\d", name)}


def test_there_are_at_most_fifteen_decisions_numbered_without_gaps(decisions):
    assert 1 < len(decisions) <= 15
    assert [int(name[len("decisions/") :][:2]) for name in decisions] == list(range(1, len(decisions) + 1))


def test_a_decision_has_all_its_parts_and_one_table(decisions):
    for name, text in decisions.items():
        assert len(re.findall(r"^\|[ :|-]*---", text, re.M)) <= 1, f"{name} has more than one table"
        for part in PARTS_OF_A_DECISION:
            assert part in text, (name, part)


def test_every_generated_page_exists(pages):
    assert set(pages) >= GENERATED


def test_pages_of_backends_show_their_picture(pages):
    for name in ("reference", "scan", "hash"):
        assert f"../images/backend_{name}.png" in pages[f"backends/{name}.md"]


def test_pages_by_hand_name_no_commit(pages):
    assert HASH.findall("made by 2f10bdd with 16 cores, not by 1234567") == ["2f10bdd"]
    for name, text in pages.items():
        if not name.startswith("benchmarks/") and name not in GENERATED:
            assert not HASH.findall(text), (name, HASH.findall(text))


def test_links_within_the_pages_lead_somewhere(pages, docs):
    counts = {"links": 0, "roles": 0}
    for name, text in pages.items():
        folder = (docs / name).parent
        prose = re.sub(r"^```[^{].*?^```", "", text, flags=re.S | re.M)
        for target in LINK.findall(prose):
            path = target.split("#")[0]
            if path and not re.match(r"\w+:", path):
                assert (folder / path).exists(), (name, target)
                counts["links"] += 1
        for target in DOC_ROLE.findall(prose):
            start = docs / target[1:] if target.startswith("/") else folder / target
            assert start.with_name(f"{start.name}.md").exists(), (name, target)
            counts["roles"] += 1
    assert min(counts.values()) > 10, counts


def test_pages_that_the_code_names_exist(repository):
    named = {
        (source.relative_to(repository).as_posix(), path)
        for folder in ("runout", "pipelines", "tests")
        for source in (repository / folder).rglob("*.py")
        for path in PATH_IN_CODE.findall(source.read_text(encoding="utf-8"))
    }
    assert len(named) > 10
    assert {(source, path) for source, path in named if not (repository / path).exists()} == set()
