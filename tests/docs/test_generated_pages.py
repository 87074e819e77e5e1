"""Generated pages: what is committed is what the records give, each page is a summary, and each record is shown."""

import pytest

from docs import measure_reports
from docs.pages.__main__ import DOCS, RECORDS, pages
from docs.pages.study_page import TABLES

LONGEST = 2000  # words of a page


@pytest.fixture(scope="module")
def made():
    """Folder and content of each page; its figures are drawn for the tests, not while pytest collects them."""
    return pages()


def test_a_page_made_from_its_record_is_the_page_in_the_documentation(made):
    for folder, page in made:
        assert (folder / f"{page.name}.md").read_text(encoding="utf-8") == page.text, f"{page.name}: run python -m docs.pages"
        for name, table in page.tables.items():
            assert (folder / TABLES / name).read_text(encoding="utf-8") == table, f"{name}: run python -m docs.pages"
        for name in page.pictures:
            assert (folder / name).is_file(), name


def test_a_page_is_a_summary_with_one_figure(made):
    for _, page in made:
        assert len(page.text.split()) < LONGEST, page.name
        assert len(page.pictures) == page.text.count("![") == 1, page.name
        assert "python -m docs.pages" in " ".join(page.text.split()), page.name
        assert page.text.endswith(".\n"), page.name


def test_every_table_is_linked_from_its_page(made):
    tables = [(page, name) for _, page in made for name in page.tables]
    assert tables
    for page, name in tables:
        assert f"<{TABLES}/{name}>" in page.text, page.name


def test_no_table_is_left_that_no_page_makes(made):
    expected = {measure_reports.TABLE, *(folder / TABLES / name for folder, page in made for name in page.tables)}
    assert {path for path in DOCS.rglob("*.csv") if "_build" not in path.parts} == expected


def test_no_record_lies_among_the_pages_and_every_record_is_small():
    assert [path for path in DOCS.rglob("*.json") if "_build" not in path.parts] == []
    assert all(path.stat().st_size < 500_000 for path in RECORDS.iterdir())
