"""The small synthetic site after one whole run."""

import pytest
from ramp_site import write_site


@pytest.fixture(scope="session")
def finished_site(tmp_path_factory):
    """The site after one whole run, and what the run said it did; only to be read."""
    from runout.workflow import hazard_map

    folder = write_site(tmp_path_factory.mktemp("study") / "ramp")
    return folder, hazard_map.run(folder, workers=1)
