"""Maps and tables of terrain, release, result and ensemble for notebooks."""

import subprocess
import sys

import numpy as np
import pytest

import runout
from runout.ensemble.run import EnsembleReport
from runout.errors import ConfigError
from runout.model.facts import as_html, crs_name
from runout.workflow.hazard_map import Outcome


@pytest.fixture(autouse=True)
def figures(monkeypatch):
    """No window, and no figure left open."""
    monkeypatch.setenv("MPLBACKEND", "agg")
    from matplotlib import pyplot

    yield pyplot
    pyplot.close("all")


@pytest.fixture(scope="module")
def terrain():
    elevation = np.tile(np.maximum(0.0, 100.0 - 4.0 * np.arange(40)), (30, 1))
    elevation[0, 0] = np.nan
    return runout.Terrain.from_array(elevation, 10.0, crs="EPSG:32632", origin=(500_000.0, 5_000_000.0))


@pytest.fixture(scope="module")
def release(terrain):
    thickness = np.zeros(terrain.shape)
    thickness[12:18, 5:10] = 4.0
    return runout.Release.from_array(thickness, terrain, placement="on_surface", name="scar")


@pytest.fixture(scope="module")
def result(terrain, release):
    material = runout.DruckerPrager(density=2000.0, youngs_modulus=2e6, friction_angle=30.0)
    return runout.simulate(terrain, release, material, basal_friction_angle=15.0, cell_size=10.0, end_time=3.0, backend="reference")


def image_of(axes):
    """Values that a map shows, without cells that have no colour."""
    return axes.get_images()[-1].get_array()


def test_a_terrain_is_drawn_as_a_map_of_its_elevation(terrain, figures):
    axes = terrain.plot(title="here")
    assert axes.figure.number in figures.get_fignums()
    assert axes.get_title(loc="left") == "here"
    shown = image_of(axes)
    assert (shown.shape, float(shown.max())) == ((30, 40), 100.0)
    assert axes.get_xlim() == pytest.approx((500_000.0, 500_400.0))
    assert "elevation [m]" in [other.get_xlabel() for other in axes.figure.axes]


def test_a_release_is_drawn_around_it_with_its_volume(release):
    axes = release.plot()
    assert axes.get_title(loc="left") == "scar: 1.2e+04 m³"
    assert float(image_of(axes).sum()) == pytest.approx(4.0 * 30)
    assert axes.get_xlim()[1] - axes.get_xlim()[0] < 400.0


@pytest.mark.parametrize("quantity", ["thickness", "speed", "pressure", "momentum_flux", "deposit", "arrival"])
def test_a_result_is_drawn_as_a_map_of_each_quantity(result, quantity):
    axes = result.plot(quantity)
    assert image_of(axes).count() > 0
    axes.figure.canvas.draw()


def test_a_quantity_that_is_none_is_refused(result):
    with pytest.raises(ConfigError, match=r"heat.*thickness, speed"):
        result.plot("heat")


def test_objects_tell_what_they_are_in_a_line_and_in_a_table(terrain, release, result):
    for thing, facts in (
        (terrain, ("30 x 40", "10 m", "0.0 to 100.0 m", "WGS 84 / UTM zone 32N", "1 cells")),
        (release, ("scar", "1.2e+04 m3", "4 m at most", "on_surface")),
        (result, ("end time at 3 s", "particles", "largest speed", "cells through a depth", "0 % of the mass")),
        (EnsembleReport((0, 1), (2,), {3: "it <broke>"}), ("members: 4", "simulated: 2", "it <broke>")),
        (Outcome(("hazard",), ("terrain",), {3: "cause"}), ("done: hazard", "up to date: terrain", "cause")),
    ):
        name, line, table = type(thing).__name__, repr(thing), thing._repr_html_()
        assert line.startswith(f"{name}(")
        assert len(line) < 600
        assert table.startswith("<table>")
        assert f"<b>{name}</b>" in table
        for fact in facts:
            assert fact in line, (name, line)
            assert fact.split(": ")[-1].replace("<", "&lt;").replace(">", "&gt;") in table


def test_a_table_escapes_what_comes_from_files():
    assert "<script>" not in as_html("Terrain", {"source": "<script>"})
    assert crs_name(None) == "local coordinates"
    assert crs_name('PROJCS["ETRS89 / LAEA", GEOGCS["x"]]') == "ETRS89 / LAEA"


def test_representations_load_no_library_for_plots():
    code = (
        "import sys, numpy as np, runout; t = runout.Terrain(np.zeros((4, 4)), (1, 1)); repr(t), t._repr_html_();"
        "r = runout.Release(np.ones((4, 4)), t); repr(r), r._repr_html_();"
        "print({'matplotlib', 'pyvista', 'pyproj', 'rasterio', 'xarray'} & {*sys.modules})"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
