"""The text of the pages of the validation holds no measured number: those come from the record of the page."""

import ast
import json
import re

import pytest

from docs.pages.__main__ import DOCS, RECORDS, VALIDATION
from docs.pages.wording import COARSE
from runout.studies.validation import RECORD

PAGES = DOCS / "pages"
PROSE = 100  # characters of a string that is text of a page
PLACE = re.compile(r"(?<!\{)\{[^{}]*\}(?!\})")
NUMBER = re.compile(r"(?<![\w.])\d+(?:\.\d+)?(?!\w)")
INPUTS = {  # choices and published values of each case, by module
    "avakot": "0.1 0.155 0.22 0.5 1 4 5 10 20 30 200 4000",
    "cascades_2021": "3 5 10 12 15 15.7 22 481 2021",
    "columns": "0.1 0.2 0.5 0.84 1 2 8 19.8 20 25 30 40 99 2004 2005 2008 2650",
    "frank_slide": "1 5 10 15 20 30 36.0 2000",
    "iseesnow": "0.001 0.1 0.4 0.5 0.6 1 1.2 1.5 2 2.5 4 5 10 12 20 21.8 30 34 40 60 100 200 400 800 1000 2000 2100",
}


def typed(text):
    """Numbers of a text that are written in it, without those that its places take from a record."""
    return set(NUMBER.findall(PLACE.sub("", text)))


def prose(module):
    """Long strings of a module, without its docstrings."""
    tree = ast.parse(module.read_text(encoding="utf-8"))
    documented = (node for node in ast.walk(tree) if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef))
    docstrings = {id(node.body[0].value) for node in documented if isinstance(node.body[0], ast.Expr)}
    strings = (node for node in ast.walk(tree) if isinstance(node, ast.Constant) and isinstance(node.value, str))
    return [node.value for node in strings if len(node.value) >= PROSE and id(node) not in docstrings]


@pytest.mark.parametrize("module", ["iseesnow_terms", *INPUTS])
def test_text_holds_no_number_but_inputs_of_its_case(module):
    """A number that was measured is a place, such as {front:.0f}, which the page fills from its record."""
    numbers = set().union(*map(typed, prose(PAGES / f"{module}.py")))
    assert numbers == set(INPUTS.get(module, "").split()), "take what was measured from the record; list inputs here"


def test_numbers_are_told_from_places_names_and_units():
    text = "In 3D, commit 290f4d9, {front:.0f} m and 12.5 m of {{doc}}`x`, 31 %, CSI 0.9."
    assert typed(text) == {"12.5", "31", "0.9"}


@pytest.mark.parametrize("name", VALIDATION)
def test_a_record_of_one_coarse_run_makes_a_page_without_the_differences(name):
    record = json.loads((RECORDS / RECORD.format(name)).read_text(encoding="utf-8"))
    results = record["results"]
    several = {key: results[key][:1] for key in ("runs", "rods") if key in results}
    only_full = {key: [] for key in ("studies", "energy", "surges") if key in results}
    page = VALIDATION[name]({**record, "full": False, "results": results | several | only_full})
    assert COARSE in page.text
    assert "**" not in page.text[page.text.index("## Differences") :]
