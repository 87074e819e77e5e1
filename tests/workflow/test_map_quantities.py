"""A map quantity is one row of a table: its maps, thresholds, files, styles and report follow."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from ramp_site import SITE, write_site

from runout.map_quantities import QUANTITIES, member_map_names, peak_quantities, quantity_of
from runout.variables import VARIABLES

HERE = Path(__file__).parent


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """What a process finds that adds the quantity ``kinetic_head`` to the table."""
    text = SITE.replace("members: 4", "members: 2").replace("percentiles:", "kinetic_head_thresholds: [0.4], percentiles:")
    folder = write_site(tmp_path_factory.mktemp("added") / "ramp", text)
    environment = {**os.environ, "PYTHONPATH": str(HERE.parents[1])}
    command = [sys.executable, HERE / "added_quantity.py", folder]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def test_an_added_quantity_is_found_by_its_formula_in_the_maps_of_a_member(found):
    assert found["head"] == pytest.approx(found["of_speed"], rel=1e-12)
    assert found["head"] > 1.0
    assert found["in_members_nc"] == pytest.approx(found["head"], rel=1e-6)


def test_an_added_quantity_has_thresholds_in_site_yaml_and_all_maps_over_the_members(found):
    assert found["resolved"] == [0.4]
    kinds = [f"kinetic_head_exceedance_{kind}" for kind in ("probability", "rms_error", "standard_error")]
    assert found["hazard"] == sorted([*kinds, "kinetic_head_percentile", "kinetic_head_threshold", "peak_kinetic_head"])


def test_an_added_quantity_has_rasters_with_styles_and_sheets_of_the_report(found):
    stems = ["kinetic_head_exceedance_probability_over_0.4", "kinetic_head_exceedance_standard_error_over_0.4"]
    stems += ["kinetic_head_percentile_50", "peak_kinetic_head"]
    assert found["maps"] == sorted(f"{stem}.{kind}" for stem in stems for kind in ("tif", "qml"))
    assert found["report"] >= 4


def test_every_quantity_of_the_table_is_described():
    assert next(iter(QUANTITIES)) == "thickness"
    assert len(peak_quantities()) == 4
    for name, q in QUANTITIES.items():
        made = [q.member_map, q.percentile, q.peak, q.threshold, q.joint_threshold, *([q.mean] if q.mean else [])]
        made += [q.exceedance(kind) for kind in ("probability", "standard_error", "rms_error")]
        assert set(made) <= VARIABLES.keys(), name
        assert {VARIABLES[one].units for one in (q.member_map, q.percentile, q.peak, q.threshold)} == {q.units}
        assert all(quantity_of(one) is q for one in (q.member_map, q.percentile, q.peak))
        assert list(q.thresholds) == sorted(set(q.thresholds))
    assert set(member_map_names()) <= VARIABLES.keys()
    assert quantity_of("elevation") is None


def test_momentum_flux_is_the_peak_of_the_product_and_not_the_product_of_peaks():
    """Thick and slow, then thin and fast: the largest h v^2 is less than what the maxima would give."""
    from runout.backends.protocol import RasterSums
    from runout.model.scene import Raster
    from runout.simulation.observers import PeakMaps

    class Scene:
        raster = Raster(3, 4, (2.0, 2.0))

    peaks = PeakMaps(Scene(), 0.1)  # type: ignore[arg-type]
    for time, (h, v) in enumerate([(5.0, 1.0), (0.5, 6.0), (0.05, 90.0), (2.0, 2.0)]):
        volume = np.full((1, 1), 4.0 * h)
        momentum = 2000.0 * volume[..., None] * np.array([0.0, 0.6 * v, 0.8 * v])
        peaks.observe(float(time), RasterSums(volume, 2000.0 * volume, momentum, 1, 2))
    maps = {name: values[1, 2] for name, values in peaks.maps().items()}
    assert maps["max_momentum_flux"] == pytest.approx(0.5 * 6.0**2), "the third look is thinner than the threshold of arrival"
    assert maps["max_momentum_flux"] < maps["max_flow_thickness"] * maps["max_speed"] ** 2
    assert maps["max_pressure"] == pytest.approx(2000.0 * 6.0**2)
