import html
import io
import re
import shutil
import sys
import tomllib
import typing
from collections.abc import Iterator
from pathlib import Path

import pytest
from links import broken
from pydantic import BaseModel
from ruamel.yaml import YAML

import runout
from runout.config.schema import SiteSettings
from runout.hazard.maps import HEADLINE_MAPS
from runout.model.friction_laws import FRICTIONS
from runout.model.laws import LAWS
from runout.variables import VARIABLES


@pytest.fixture(scope="module")
def pages(repository, tmp_path_factory):
    """The built pages, without runs of the gallery; a warning of sphinx is an error. The gallery writes to the sources: a copy."""
    from sphinx.application import Sphinx

    folder = tmp_path_factory.mktemp("pages")
    source, target = folder / "docs", folder / "html"
    shutil.copytree(repository / "docs", source, ignore=shutil.ignore_patterns("_build", "pictures", "__pycache__"))
    for name in ("runout", "sites", "tests"):
        (folder / name).symlink_to(repository / name)
    warnings = io.StringIO()
    application = Sphinx(
        source,
        source,
        target,
        target / "doctrees",
        "html",
        {"nb_execution_mode": "off", "plot_gallery": "False"},
        status=None,
        warning=warnings,
        freshenv=True,
    )
    application.build()
    assert warnings.getvalue() == ""
    return target


def text_of(page: Path) -> str:
    """Text of a page without its tags."""
    return html.unescape(re.sub(r"<[^>]+>", "", page.read_text(encoding="utf-8"))).replace("\u2019", "'")


def test_sphinx_builds_every_page_without_a_warning(pages, repository):
    sources = [p.relative_to(repository / "docs") for p in (repository / "docs").rglob("*.md") if "_build" not in p.parts]
    assert len(sources) > 15
    for page in sources:
        assert (pages / page.with_suffix(".html")).exists()


def test_every_link_and_anchor_within_the_pages_is_there(pages):
    assert broken(pages) == []


def test_a_link_to_a_page_a_picture_or_an_anchor_that_is_not_there_is_found(tmp_path):
    (tmp_path / "a.html").write_text('<a id="top" href="b.html#here"></a><a href="#top"></a><a href="https://x.org/y"></a>')
    (tmp_path / "b.html").write_text('<p id="here"><a href="c.html"></a><img src="d.png"><a href="a.html#gone"></a></p>')
    assert broken(tmp_path) == ["b.html: a.html#gone", "b.html: c.html", "b.html: d.png"]


def test_every_file_that_the_readme_names_is_there(repository):
    text = (repository / "README.md").read_text()
    named = re.findall(r"`(docs/[\w/.]+|CONTRIBUTING.md)`", text) + re.findall(r"\]\((?!http)([^)]+)\)", text)
    assert len(named) > 3
    for path in named:
        assert (repository / path).exists(), path


def test_every_public_name_is_on_the_api_page(pages):
    text = text_of(pages / "api.html")
    for name in runout.__all__:
        assert name in text, name


def keys_of(model: type[BaseModel]) -> Iterator[str]:
    """Keys of a block of site.yaml and of the blocks in it."""
    for key, field in model.model_fields.items():
        yield key
        for inner in blocks_in(field.annotation):
            yield from keys_of(inner)


def blocks_in(annotation: object) -> Iterator[type[BaseModel]]:
    """Models that an annotation names."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in typing.get_args(annotation):
        yield from blocks_in(part)


def test_every_key_of_site_yaml_is_in_a_table_of_the_guide(pages):
    folder = pages / "guide" / "site_yaml"
    tables = re.findall(r"<td><p><code[^>]*>(.*?)</code>", "".join(page.read_text() for page in folder.glob("*.html")))
    named = {text for cell in tables for text in re.findall(r"[\w]+", re.sub(r"<[^>]+>", "", cell))}
    assert {"resolution", "cone", "standard_deviation", "sha256"} <= set(keys_of(SiteSettings)) | named
    assert set(keys_of(SiteSettings)) - set(SiteSettings.model_fields) - named == set()


def test_the_overview_of_site_yaml_names_every_block_and_links_every_page(pages, repository):
    overview = (repository / "docs" / "guide" / "site_yaml" / "index.md").read_text().split("## Blocks")[1].split("## Top")[0]
    for key in SiteSettings.model_fields:
        assert re.search(rf"\b{key}\b", overview), key
    others = {path.name for path in (repository / "docs" / "guide" / "site_yaml").glob("*.md")} - {"index.md"}
    assert others == set(re.findall(r"\]\(([\w.]+)\)", overview))


def test_no_key_of_site_yaml_lacks_a_meaning(pages):
    paths = sorted((pages / "guide" / "site_yaml").glob("*.html"))
    assert len(paths) > 1
    for page in paths:
        assert "<td><p>None</p></td>" not in page.read_text(), page.name


def test_every_law_is_in_the_theory_with_its_formula(pages):
    text = text_of(pages / "theory.html")
    for law in (*LAWS.of_runout(), *FRICTIONS.of_runout()):
        assert f"{law.name}:" in text
        assert sys.modules[law.declaration.__module__].__doc__.splitlines()[0] in text


def test_every_headline_map_is_in_the_guide_with_its_meaning(pages):
    text = text_of(pages / "guide" / "outputs" / "hazard_nc.html")
    for name in HEADLINE_MAPS:
        assert name in text
        assert VARIABLES[name].long_name in text


def test_the_example_of_the_guide_is_a_valid_site(repository):
    guide = (repository / "docs" / "guide" / "site_yaml" / "index.md").read_text()
    example = re.search(r"^```yaml\n(.*?)^```", guide, re.S | re.M)
    settings = SiteSettings.model_validate(YAML(typ="safe").load(example[1]))
    assert settings.ensemble.members == 32
    assert settings.budget.hours == 8


def test_the_tree_of_the_architecture_is_the_tree_of_the_package(repository):
    tree = re.search(r"```text\nrunout/\n(.*?)```", (repository / "docs" / "architecture.md").read_text(), re.S)[1]
    named = set(re.findall(r"^  (\w+)/", tree, re.M))
    packages = {p.parent.name for p in (repository / "runout").glob("*/__init__.py")}
    assert named == packages
    for module in re.findall(r"^  (\w+\.py)", tree, re.M):
        assert (repository / "runout" / module).exists(), module


def test_equations_are_numbered_and_every_paper_cited_is_listed(repository):
    theory = (repository / "docs" / "theory.md").read_text()
    body, papers = theory.split("## Papers")
    assert len(re.findall(r"^:label: ", body, re.M)) >= 15
    for author, year in re.findall(r"([A-Z]\w+)(?: et al\.)? \(?((?:19|20)\d\d)", body):
        assert any(author in entry and f"({year})" in entry for entry in papers.split("\n- ")), (author, year)


def test_readme_prints_the_two_commands_that_ci_runs(repository):
    lines = (repository / "README.md").read_text().splitlines()
    assert lines.count("python3 -m venv .venv && .venv/bin/pip install -q . && .venv/bin/runout run sites/jacksboro") == 1
    assert lines.count('python3 -m venv .venv && .venv/bin/pip install -q -e ".[test]" && .venv/bin/python -m pytest -n 2') == 1


def test_pictures_that_the_pages_show_exist(repository):
    for page in (repository / "README.md", repository / "docs" / "index.md"):
        pictures = re.findall(r"!\[[^\]]*\]\(([^)]+)\)", page.read_text())
        assert pictures, page
        for picture in pictures:
            assert (page.parent / picture).read_bytes().startswith(b"\x89PNG"), picture


def test_the_version_is_the_same_in_citation_and_changelog(repository):
    citation = YAML(typ="safe").load((repository / "CITATION.cff").read_text())
    assert citation["version"] == runout.__version__
    assert citation["license"] == tomllib.loads((repository / "pyproject.toml").read_text())["project"]["license"]
    assert f"## {runout.__version__}" in (repository / "docs" / "changelog.md").read_text()
