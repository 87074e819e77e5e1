from pathlib import Path

import netCDF4
import numpy as np
import pytest
import xarray as xr
from compliance_checker.runner import CheckSuite, ComplianceChecker
from synthetic_ensemble import Products, make_terrain, member_maps, write_part

from runout.io import netcdf
from runout.variables import VARIABLES


def checker_report(path: Path, report: Path) -> str:
    """What the checker of the CF conventions 1.11 says of a file, at its strictest."""
    CheckSuite.load_all_available_checkers()
    passed, errors = ComplianceChecker.run_checker(str(path), ["cf:1.11"], 0, "strict", output_filename=str(report))
    assert not errors
    text = report.read_text()
    assert passed == ("All tests passed!" in text)
    return text


@pytest.mark.parametrize("crs", ["EPSG:32616", "EPSG:2056", "EPSG:31287", "EPSG:5514", "EPSG:28992", None])
def test_a_member_file_passes_the_strict_checker(crs: str | None, tmp_path: Path) -> None:
    series = {"mass": [3.0, 3.0], "dt": [0.1, 0.1], "active_nodes": [64, 128], "sparsity": [1.0, np.nan], "memory": [10**9, 10**9]}
    ledger = xr.Dataset({name: ("time", values) for name, values in series.items()}, coords={"time": [0.0, 0.1]})
    dataset = netcdf.map_dataset(make_terrain(crs), member_maps(1), title="member 1", attrs={"member_key": "abc"})
    path = netcdf.write(dataset, tmp_path / "0001.nc", groups={"ledger": ledger})
    report = checker_report(path, tmp_path / "report.txt")
    assert "All tests passed!" in report, report


@pytest.mark.parametrize("crs", ["EPSG:32616", "EPSG:5514", None])
def test_a_member_file_with_a_part_of_the_raster_passes_the_strict_checker(crs: str | None, tmp_path: Path) -> None:
    report = checker_report(write_part(tmp_path, 1, make_terrain(crs), member_maps(1)), tmp_path / "report.txt")
    assert "All tests passed!" in report, report


# the checker takes longest for hazard.nc, whose grid is described as that of the files of members
@pytest.mark.parametrize(
    ("system", "name"), [("products", "hazard.nc"), ("products", "members.nc"), ("local_products", "members.nc")]
)
def test_products_pass_the_strict_checker(system: str, name: str, request: pytest.FixtureRequest, tmp_path: Path) -> None:
    report = checker_report(request.getfixturevalue(system).results / name, tmp_path / "report.txt")
    assert "All tests passed!" in report, report


def test_the_checker_would_find_a_fault(tmp_path: Path) -> None:
    faulty = write_part(tmp_path, 1, make_terrain(), member_maps(1))
    with netCDF4.Dataset(faulty, "a") as file:
        file["max_speed"].units = "furlongs per forthnight"
    assert "max_speed" in checker_report(faulty, tmp_path / "report.txt")


def test_every_variable_of_the_products_is_in_the_table_with_its_unit(products: Products) -> None:
    for name in ("hazard.nc", "members.nc"):
        with netCDF4.Dataset(products.results / name) as file:
            described = [v for v in file.variables.values() if v.name not in ("x", "y", "crs")]
            assert len(described) > 10
            for variable in described:
                assert variable.long_name == VARIABLES[variable.name].long_name
                assert getattr(variable, "units", "") == VARIABLES[variable.name].units


def test_standard_names_are_only_those_that_exist() -> None:
    named = {v.standard_name for v in VARIABLES.values() if v.standard_name}
    assert named == {"surface_altitude", "ground_slope_angle", "realization"}
