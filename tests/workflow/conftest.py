"""The small synthetic site after one whole run, and notes on kernels that no other test has made."""

import pytest
from ramp_site import write_site

from runout.forecast import engine_notes


@pytest.fixture(autouse=True)
def notes(monkeypatch, tmp_path_factory):
    """Folder of the notes on kernels; empty at the start of each test."""
    folder = tmp_path_factory.mktemp("notes")
    monkeypatch.setattr(engine_notes, "_folder", lambda: folder)
    return folder


@pytest.fixture(scope="session")
def finished_site(tmp_path_factory):
    """The site after one whole run, and what the run said it did; only to be read."""
    from runout.workflow import hazard_map

    folder = write_site(tmp_path_factory.mktemp("study") / "ramp")
    return folder, hazard_map.run(folder, workers=1)
