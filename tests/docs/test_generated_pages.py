"""Generated pages: what is committed is what the records give, each page is a summary, and each record is shown."""

import pytest

from docs import measure_reports
from docs.pages.__main__ import DOCS, RECORDS, pages
from docs.pages.study_page import TABLES

LONGEST = 2000  # words of a page
MADE = pages()


@pytest.fixture(params=MADE, ids=lambda made: made[1].name)
def made(request):
    """Folder and content of a page."""
    return request.param


def test_a_page_made_from_its_record_is_the_page_in_the_documentation(made):
    folder, page = made
    assert (folder / f"{page.name}.md").read_text(encoding="utf-8") == page.text, "run python -m docs.pages"
    for name, table in page.tables.items():
        assert (folder / TABLES / name).read_text(encoding="utf-8") == table, "run python -m docs.pages"
    for name in page.pictures:
        assert (folder / name).is_file(), name


def test_a_page_is_a_summary_with_one_figure(made):
    _, page = made
    assert len(page.text.split()) < LONGEST
    assert len(page.pictures) == page.text.count("![") == 1
    assert "python -m docs.pages" in " ".join(page.text.split())
    assert page.text.endswith(".\n")


@pytest.mark.parametrize("page", [page for _, page in MADE if page.tables], ids=lambda page: page.name)
def test_every_table_is_linked_from_its_page(page):
    for name in page.tables:
        assert f"<{TABLES}/{name}>" in page.text


def test_no_table_is_left_that_no_page_makes():
    expected = {measure_reports.TABLE, *(folder / TABLES / name for folder, page in MADE for name in page.tables)}
    assert {path for path in DOCS.rglob("*.csv") if "_build" not in path.parts} == expected


def test_no_record_lies_among_the_pages_and_every_record_is_small():
    assert [path for path in DOCS.rglob("*.json") if "_build" not in path.parts] == []
    assert all(path.stat().st_size < 500_000 for path in RECORDS.iterdir())
