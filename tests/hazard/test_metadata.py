"""What the products say about themselves: ACDD 1.3, checksums, and nothing that is not known."""

import hashlib
import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import netCDF4
import pytest
import rasterio
from compliance_checker.runner import CheckSuite, ComplianceChecker
from synthetic_ensemble import Products, make_site, make_table

from runout.config.schema import MetadataSettings
from runout.hazard.products import write_products

STATED = MetadataSettings(
    author="A. Name",
    email="name@example.org",
    url="https://example.org/name",
    institution="A survey",
    project="Valley 2030",
    purpose="screening of a road; not for single buildings",
    license="CC-BY-4.0",
    references="report 17",
    acknowledgement="elevations of the land survey",
)
NOT_KNOWN = {  # attributes of ACDD that no study of runout has, or only its publisher knows
    "naming_authority", "contributor_name", "contributor_role", "program", "metadata_link", "product_version",
    "publisher_name", "publisher_url", "publisher_email", "publisher_type", "publisher_institution",
    "time_coverage_start", "time_coverage_end", "time_coverage_duration", "time_coverage_resolution",
    "geospatial_bounds_vertical_crs", "geospatial_vertical_resolution", "keywords_vocabulary",
    "platform", "platform_vocabulary", "instrument", "instrument_vocabulary",
}  # fmt: skip


@pytest.fixture(scope="module")
def stated(tmp_path_factory: pytest.TempPathFactory) -> Products:
    """Products of a site that says who made the study."""
    site, results = make_site(tmp_path_factory.mktemp("stated"))
    site = replace(
        site, settings=SimpleNamespace(**vars(site.settings) | {"metadata": STATED, "ensemble": SimpleNamespace(seed=0)})
    )
    return Products(site, results, write_products(site, results, make_table(), None))


def missing(path: Path, report: Path) -> set[str]:
    """Global attributes that the checker of ACDD 1.3 misses."""
    CheckSuite.load_all_available_checkers()
    ComplianceChecker.run_checker(str(path), ["acdd:1.3"], 0, "strict", output_filename=str(report), output_format="json")
    found = json.loads(report.read_text())
    found = found.get("acdd:1.3", found)
    groups = [group for level in ("high", "medium", "low") for group in found[f"{level}_priorities"]]
    said = [text for group in groups if group["name"] == "Global Attributes" for text in group["msgs"]]
    return {text.removesuffix(" not present").split("/")[-1] for text in said}


def test_every_attribute_of_acdd_that_is_known_is_stated(stated: Products, tmp_path: Path) -> None:
    assert missing(stated.results / "hazard.nc", tmp_path / "report.json") <= NOT_KNOWN


def test_the_checker_of_acdd_misses_what_nobody_stated(products: Products, tmp_path: Path) -> None:
    assert missing(products.results / "hazard.nc", tmp_path / "report.json") >= {"creator_name", "license", "institution"}


@pytest.mark.parametrize("system", ["products", "local_products", "stated"])
@pytest.mark.parametrize("name", ["hazard.nc", "members.nc"])
def test_no_attribute_stands_for_something_unknown(system: str, name: str, request: pytest.FixtureRequest) -> None:
    with netCDF4.Dataset(request.getfixturevalue(system).results / name) as file:
        values = [str(file.getncattr(key)).strip().lower() for key in file.ncattrs()]
        values += [str(v.getncattr(key)).strip().lower() for v in file.variables.values() for key in v.ncattrs()]
    assert len(values) > 50
    assert not [v for v in values if v in ("", "none", "nan", "unknown", "n/a") or "not stated" in v or v.startswith("none")]


def test_who_and_what_for_are_in_the_files_and_the_record(stated: Products) -> None:
    with netCDF4.Dataset(stated.results / "hazard.nc") as file:
        assert (file.creator_name, file.creator_type, file.creator_institution) == ("A. Name", "person", "A survey")
        assert (file.license, file.purpose) == ("CC-BY-4.0", STATED.purpose)
        assert file.geospatial_bounds.startswith("POLYGON ((36.29")
        assert (file.geospatial_vertical_min, file.geospatial_vertical_positive) == (pytest.approx(790.0), "up")
    with rasterio.open(stated.results / "maps" / "peak_speed.tif") as raster:
        assert (raster.tags()["creator_name"], raster.tags()["license"]) == ("A. Name", "CC-BY-4.0")
    assert json.loads((stated.results / "run.json").read_text())["metadata"] == STATED.model_dump()


def test_the_seed_of_the_ensemble_is_stated_whatever_it_is(stated: Products, products: Products) -> None:
    for study, seed in ((stated, 0), (products, 7)):
        with netCDF4.Dataset(study.results / "hazard.nc") as file:
            assert file.seed == seed


def test_a_local_system_has_no_geographic_extent(local_products: Products) -> None:
    with netCDF4.Dataset(local_products.results / "hazard.nc") as file:
        assert not [name for name in file.ncattrs() if name.startswith(("geospatial_lat", "geospatial_lon", "geospatial_bounds"))]
        assert file.geospatial_vertical_max > file.geospatial_vertical_min


def test_the_record_holds_the_checksum_of_every_product(products: Products) -> None:
    record = json.loads((products.results / "run.json").read_text())["products"]
    written = [path for path in products.paths if path.name != "run.json"]
    assert [entry["name"] for entry in record] == [path.relative_to(products.results).as_posix() for path in written]
    for entry, path in zip(record, written, strict=True):
        content = path.read_bytes()
        assert (entry["size"], entry["sha256"]) == (len(content), hashlib.sha256(content).hexdigest())
