"""Length of the pages, and the places that they and the code name."""

import re
from pathlib import Path

import pytest

WORDS_BY_HAND, WORDS_OF_A_DECISION, WORDS_OF_A_BACKEND, WORDS_OF_CHANGES = 25_400, 350, 650, 1_650
GENERATED = {
    "stress.md",
    "verification.md",
    "benchmarks/commands.md",
    "benchmarks/error_bars.md",
    "benchmarks/gpu.md",
    "benchmarks/published.md",
    "benchmarks/skip.md",
    "benchmarks/transfers.md",
    "benchmarks/work_precision.md",
    "validation/avakot.md",
    "validation/cascades_2021.md",
    "validation/columns.md",
    "validation/coulomb_only.md",
    "validation/frank_slide.md",
    "validation/idealized_topo.md",
}
PARTS_OF_A_DECISION = ("**What", "**Why", "**Evidence", "**Cost", "**What would overturn it.**")
HASH = re.compile(r"\b(?=[0-9a-f]*[0-9])(?=[0-9a-f]*[a-f])[0-9a-f]{7,40}\b")
LINK = re.compile(r"\]\(([^)\s]+)\)")
DOC_ROLE = re.compile(r"\{doc\}`(?:[^`<]*<)?([^`>]+)>?`")
PATH_IN_CODE = re.compile(r"\bdocs/[\w./-]+\.(?:md|json|png|py)\b")


def words(text: str) -> int:
    """Number of words and numbers; rules and bars of tables are none."""
    return sum(1 for word in text.split() if re.search(r"\w", word))


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


def test_a_decision_fits_on_a_screen_and_has_all_its_parts(decisions):
    for name, text in decisions.items():
        assert words(text) <= WORDS_OF_A_DECISION, (name, words(text))
        assert len(re.findall(r"^\|[ :|-]*---", text, re.M)) <= 1, f"{name} has more than one table"
        for part in PARTS_OF_A_DECISION:
            assert part in text, (name, part)


def test_pages_by_hand_have_few_words_in_all(pages):
    assert set(pages) >= GENERATED
    by_hand = {name: words(text) for name, text in pages.items() if name not in GENERATED}
    assert sum(by_hand.values()) <= WORDS_BY_HAND, by_hand


def test_pages_of_backends_and_the_changelog_are_short(pages):
    for name in ("reference", "scan", "hash"):
        text = pages[f"backends/{name}.md"]
        assert words(text) <= WORDS_OF_A_BACKEND, name
        assert f"../images/backend_{name}.png" in text
    assert words(pages["changelog.md"]) <= WORDS_OF_CHANGES


def test_pages_by_hand_name_no_commit(pages):
    for name, text in pages.items():
        if not name.startswith("benchmarks/") and name not in GENERATED:
            assert not HASH.findall(text), (name, HASH.findall(text))


def test_links_within_the_pages_lead_somewhere(pages, docs):
    for name, text in pages.items():
        folder = (docs / name).parent
        prose = re.sub(r"^```[^{].*?^```", "", text, flags=re.S | re.M)
        for target in LINK.findall(prose):
            path = target.split("#")[0]
            if path and not re.match(r"\w+:", path):
                assert (folder / path).exists(), (name, target)
        for target in DOC_ROLE.findall(prose):
            start = docs / target[1:] if target.startswith("/") else folder / target
            assert start.with_name(f"{start.name}.md").exists(), (name, target)


def test_pages_that_the_code_names_exist(repository):
    for folder in ("runout", "pipelines", "tests"):
        for source in sorted((repository / folder).rglob("*.py")):
            for path in PATH_IN_CODE.findall(source.read_text(encoding="utf-8")):
                assert (repository / path).exists(), (source.relative_to(repository), path)
