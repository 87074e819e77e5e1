"""What the verification writes: its record, the page of it; and what its command says."""

import csv
import json

import pytest

from docs.pages.verification import page
from runout.cli import main
from runout.studies import verification
from runout.studies.verification_cases.finding import Bound, Case, Convergence, Finding, as_json, as_lines
from runout.studies.work_precision import commit

CASE = Case("U0", "a case", "a set-up", lambda full: [], "A remark.")
GOOD, BAD = Bound("a length [m]", 2e-5, 1e-4), Convergence("an error", (8, 16), (0.1, 0.09), 2.0)


def page_of(*results):
    """Page of one case with these results."""
    content = as_json([Finding(CASE, results, 1.0)], False)
    return page({**content, "cases_asked": ["U0"], "commit": "abc", "command": "runout verify --out DIR"})


def test_page_names_what_does_not_hold():
    made = page_of(GOOD, BAD)
    assert "**Does not hold: U0.**" in made.text
    assert "| U0 | a case | 2 | 0.15 (2) | a length [m]: 2e-05 (at most 0.0001) | **no** |" in made.text
    assert "All 1 cases hold." in page_of(GOOD).text


def test_tables_hold_every_quantity_set_up_and_remark():
    results, cases = (
        list(csv.reader(page_of(GOOD, BAD).tables[f"verification{name}.csv"].splitlines())) for name in ("", "_cases")
    )
    assert results[1:] == [
        ["U0", "a length [m]", "2e-05", "at most 0.0001", "yes"],
        ["U0", "an error", "8: 0.1, 16: 0.09; order 0.15", "order 2", "no"],
    ]
    assert cases[1] == ["U0", "a case", "a set-up", "A remark.", "1.0"]


@pytest.mark.parametrize(
    ("bound", "closest"),
    [
        (Bound("wide", 0.5, high=1.0), "wide"),
        (Bound("at the end of its range", 0.9, high=1.0, low=-1.0), "at the end of its range"),
        (Bound("below a least value", 1.25, low=1.0), "below a least value"),
        (Bound("in the middle of its range", 0.5, high=1.0, low=0.0), "a length [m]"),
        (Bound("without a bound", 9.0), "a length [m]"),
    ],
)
def test_summary_shows_the_number_that_is_closest_to_its_bound(bound, closest):
    assert f"| 2 |  | {closest}: " in page_of(GOOD, bound).text


def test_terminal_names_what_does_not_hold():
    lines = as_lines(Finding(CASE, (GOOD, BAD), 1.0))
    assert lines[0] == "U0 a case: DOES NOT HOLD (1.0 s)"
    assert [line.strip().startswith("NOT: ") for line in lines[1:]] == [False, True]


def test_json_states_bounds_orders_and_verdicts():
    content = as_json([Finding(CASE, (GOOD, BAD), 1.0)], False)
    assert content["holds"] is False
    bound, series = content["cases"][0]["results"]
    assert (bound["value"], bound["low"], bound["high"], bound["holds"]) == (2e-5, None, 1e-4, True)
    assert series["order"] == pytest.approx(0.152, abs=1e-3)
    assert json.loads(json.dumps(content)) == content


def test_command_writes_a_record_that_makes_page_tables_and_figure(tmp_path):
    assert main(["verify", "U1", "U10", "--out", str(tmp_path), "--json", str(tmp_path / "again.json")]) == 0
    record = json.loads((tmp_path / "verification.json").read_text())
    made = page(record)
    assert "runout verify U1 U10 --out DIR" in made.text
    assert "| U1 | weights |" in made.text
    assert "| U10 | element paths |" in made.text
    assert made.tables["verification.csv"].count("\nU10,") > 5
    assert made.pictures["images/verification.png"].startswith(b"\x89PNG")
    assert json.loads((tmp_path / "again.json").read_text()).keys() == {"version", "full", "holds", "cases"}
    assert record["cases_asked"] == ["U1", "U10"]
    assert record["commit"] == commit()


@pytest.fixture
def measured(monkeypatch, tmp_path):
    """Names of the measured cases of a run of two, which was interrupted in the second; a further run measures both whole."""
    measured, broken = [], ["A2"]

    def case(name):
        def measure(full):
            measured.append(name)
            if name in broken:
                raise KeyboardInterrupt
            return [GOOD, Bound("a length that may be any [m]", 3.0), BAD]

        return Case(name, "a case", "a set-up", measure)

    monkeypatch.setattr(verification, "CASES", {name.lower(): case(name) for name in ("A1", "A2")})
    with pytest.raises(KeyboardInterrupt):
        verification.run(full=True, out=tmp_path)
    broken.clear()
    return measured


def test_a_run_that_was_broken_off_goes_on_after_its_last_whole_case(measured, tmp_path):
    assert "Not finished: A2." in page(json.loads((tmp_path / "verification.json").read_text())).text
    findings = verification.run(full=True, out=tmp_path)
    assert measured == ["A1", "A2", "A2"]
    assert findings[0].results == findings[1].results
    text = page(json.loads((tmp_path / "verification.json").read_text())).text
    assert "| A1 | a case |" in text
    assert "| A2 | a case |" in text
    assert "Not finished" not in text
    verification.run(full=True, out=tmp_path)
    assert measured[3:] == ["A1", "A2"], "a run that had ended is measured again"


@pytest.mark.parametrize("changed", [{"full": False}, {"cases": ("A2", "A1")}, {"commit": "another"}])
def test_a_run_broken_off_is_not_mixed_with_other_code_or_sizes(measured, tmp_path, monkeypatch, changed):
    commit_now = changed.get("commit", commit())
    monkeypatch.setattr(verification, "commit", lambda: commit_now)
    choices = {name: value for name, value in changed.items() if name != "commit"}
    verification.run(**{"full": True, **choices}, out=tmp_path)
    assert sorted(measured[2:]) == ["A1", "A2"]


def test_command_prints_the_errors_of_a_plane_of_the_readers_choice(capsys):
    assert main(["-q", "verify", "sliding-box", "--slope", "27", "--azimuth", "63", "--offset", "0.37", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert abs(found["relative_displacement_error"]) < 0.02
    assert abs(found["residual_speed"]) < 0.01
    assert abs(found["mean_gap"]) < 0.25
    assert (found["setup"]["slope_deg"], found["setup"]["azimuth_deg"], found["setup"]["offset"]) == (27.0, 63.0, 0.37)
    assert found["seconds"] > 0


def test_command_fails_when_a_case_does_not_hold(monkeypatch):
    monkeypatch.setitem(verification.CASES, "u1", Case("U1", "weights", "", lambda full: [BAD]))
    assert main(["-q", "verify", "U1"]) == 1


@pytest.mark.parametrize(
    ("words", "message"),
    [("U99", "no case 'U99'; choose among U1"), ("U1 --slope 3", "slope"), ("sliding-box --slope 70", "slope is 70 deg")],
)
def test_command_refuses_what_it_cannot_run(words, message, capsys):
    assert main(["verify", *words.split()]) == 2
    assert message in capsys.readouterr().err
