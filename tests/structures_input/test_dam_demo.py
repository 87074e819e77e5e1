"""The synthetic site with a dam: its inputs are those of its script, and nothing of it is refused."""

import runpy
from pathlib import Path

from runout import read_site
from runout.workflow import check

SITE = Path(__file__).parents[2] / "sites" / "dam_demo"


def test_inputs_are_what_the_script_makes(tmp_path):
    runpy.run_path(str(SITE / "inputs" / "make_inputs.py"))["main"](tmp_path)
    made = sorted(path.name for path in tmp_path.iterdir())
    assert made == sorted(path.name for path in (SITE / "inputs").iterdir() if path.suffix in (".geojson", ".tif"))
    for name in made:
        if name.endswith(".geojson"):
            assert (tmp_path / name).read_text() == (SITE / "inputs" / name).read_text()
    assert read_site(SITE).settings.description.startswith("SYNTHETIC")


def test_check_finds_no_problem_and_all_structures():
    found = check.inspect(SITE)
    assert found.problems == []
    bodies = found.site.files.bodies().solids
    assert [body.name for body in bodies] == ["gallery", "house north", "house west", "house south", "dam"]
    assert [body.clearance is not None for body in bodies] == [True, False, False, False, False]
    assert "runout run sites/dam_demo" in (SITE / "README.md").read_text()
