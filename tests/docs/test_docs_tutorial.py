import re

import xarray as xr


def test_the_code_of_the_tutorial_runs_and_its_assertions_hold(repository, tmp_path, monkeypatch):
    cells = re.findall(r"^```\{code-cell\} python\n(.*?)^```", (repository / "docs" / "tutorial.md").read_text(), re.S | re.M)
    assert len(cells) >= 8
    monkeypatch.chdir(tmp_path)
    scope: dict = {}
    for number, cell in enumerate(cells):
        exec(compile(cell, f"docs/tutorial.md, cell {number}", "exec"), scope)
    with xr.open_dataset(tmp_path / "run.nc") as kept:
        assert float(kept["max_speed"].max()) == float(scope["speed"].max())
