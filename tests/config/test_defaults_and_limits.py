"""Defaults of a short site.yaml, limits of its numbers at both ends, and the words of messages on wrong values."""

import datetime

import pytest
from pydantic import ValidationError
from refused_site import problems

from runout.config import schema
from runout.config.distributions import DISTRIBUTIONS
from runout.config.hazard import HazardSettings
from runout.config.observations import DepositSettings, DifferenceSettings, GaugeSettings, OutlineSettings, ThalwegSettings
from runout.config.probes import ProbeSettings
from runout.config.read import load
from runout.config.stability import StabilitySettings
from runout.config.structures import StructureSettings
from runout.config.wording import choice_fix, nearest, shown

SIMULATION = {"cell_size": 10.0, "end_time": 30.0}
PARAMETERS = {"basal_friction_angle_deg": {"distribution": "uniform", "low": 12.0, "high": 22.0}}
MESH = {"file": "house.obj", "units": "m"}


def test_what_a_short_file_leaves_out_has_its_default(site_folder):
    settings = load(site_folder)
    expected = {
        "terrain": dict.fromkeys(("extent", "resolution", "smoothing", "obstacles", "friction_zones", "friction_rasters")),
        "simulation": {
            "accuracy": None, "particles_per_cell": None, "stop_when_at_rest": True, "backend": "scan", "device": "cpu",
            "threads": None, "precision": "float32", "substeps": 4, "initial_stress": "at_rest", "cfl": 0.6,
            "arrival_threshold": 0.1, "snapshots": None,
        },
        "ensemble": {"tolerance": None, "seed": 0},
        "hazard": {
            "thickness_thresholds": [0.1, 0.5, 1.0, 2.0], "speed_thresholds": [1.0, 5.0], "pressure_thresholds": [3e3, 3e4],
            "momentum_flux_thresholds": [1.0, 10.0, 100.0], "deposit_thresholds": [0.5, 1.0], "joint": None,
            "percentiles": [5.0, 50.0, 95.0],
        },
    }  # fmt: skip
    for section, values in expected.items():
        values_of_site = getattr(settings, section).model_dump()
        assert {key: values_of_site[key] for key in values} == values, section
    release = {"placement": "excavated", **dict.fromkeys(("layer", "raster", "sign", "volume", "edge", "basal_friction"))}
    values_of_site = settings.release[0].model_dump()
    assert {key: values_of_site[key] for key in release} == release
    assert (settings.description, settings.title) == ("", "A tilted plane")
    for block in ("metadata", "structures", "basal_friction", "probes", "stability", "observations", "report", "budget"):
        assert getattr(settings, block) is None, block


def test_blocks_that_are_opened_have_their_defaults():
    assert schema.EnsembleSettings().members == 1
    assert schema.EnsembleSettings().parameters == {}
    assert schema.ReleaseSettings(raster="a.tif").name == "release"
    assert schema.ReportSettings().stills == "none"
    assert OutlineSettings(polygons="a.gpkg").shows == "flow"
    assert (DepositSettings(raster="a.tif").thickness, DepositSettings(raster="a.tif").nodata) == ("vertical", "unknown")
    assert (DifferenceSettings(raster="a.tif").detection_limit, DifferenceSettings(raster="a.tif").nodata) == (0.0, "unknown")
    assert ProbeSettings(points="a.gpkg").interval is None
    house = StructureSettings(file="a.gpkg")
    assert (house.name, house.friction_angle_deg, house.top, house.height, house.offset) == ("structure", 20.0, None, None, None)
    soil = StabilitySettings()
    assert (soil.soil_density, soil.samples, soil.sample_seed, soil.probability) == (2000.0, 256, 0, 0.5)
    assert (soil.largest_drainage, soil.least_area, soil.most, soil.saturation) == (1e5, 500.0, 20, None)
    ranges = {
        "cohesion": (0, 4900),
        "friction_angle_deg": (30, 45),
        "soil_thickness": (0.5, 1.5),
        "transmissivity_recharge": (2e3, 3e3),
    }
    for name, ends in ranges.items():
        assert (getattr(soil, name).low, getattr(soil, name).high) == ends, name


LIMITS = [  # model, other keys, key, valid values, values that are refused
    (schema.SimulationSettings, SIMULATION, "threads", [1, 64], [0, -1, 1.5]),
    (schema.SimulationSettings, SIMULATION, "snapshots", [2, 1000], [1, 1001]),
    (schema.SimulationSettings, SIMULATION, "device", ["cpu"], ["gpu", "cuda:x", "cpu0", "cuda:0"]),
    (schema.SimulationSettings, {**SIMULATION, "backend": "hash"}, "device", ["cpu", "cuda", "cuda:1"], ["cuda:", "xcuda:0"]),
    (schema.SimulationSettings, {"end_time": 30.0}, "cell_size", [10.0, [5.0, 5.0, 4.0]], [[5.0, 5.0], [5.0] * 4, "ten"]),
    (schema.SimulationSettings, SIMULATION, "particles_per_cell", [1, 512, [1, 1, 32]], [0, 513, [1, 1], [1, 1, 33], [1] * 4]),
    (schema.EnsembleSettings, {}, "members", [1, 100_000], [0, 100_001, 2.5]),
    (schema.EnsembleSettings, {}, "seed", [0, 2**31 - 1], [-1, 2**31]),
    (schema.EnsembleSettings, {"members": 16, "parameters": PARAMETERS}, "tolerance", [1e-6, 0.2], [0.0, 0.21]),
    (schema.EnsembleSettings, {"tolerance": 0.02, "parameters": PARAMETERS}, "members", [16, 32, 65_536], [8, 15, 17, 48]),
    (schema.BudgetSettings, {}, "hours", [1e-6], [0.0]),
    (schema.BudgetSettings, {}, "memory_gb", [1e-6], [0.0]),
    (schema.BudgetSettings, {}, "disk_gb", [1e-6], [0.0]),
    (schema.MetadataSettings, {}, "author", ["a", "a" * 500], ["", "a" * 501]),
    (schema.MetadataSettings, {}, "email", ["a@b"], ["a", "a b@c", "a@b@c", "@b"]),
    (schema.MetadataSettings, {}, "url", ["http://a", "https://a"], ["ftp://a", "a"]),
    (schema.ReleaseSettings, {"raster": "a.tif"}, "name", ["a", "A-1_b", "0"], ["", "-a", "_a", "a b", "a/b"]),
    (schema.ReleaseSettings, {"thickness": 3.0}, "polygons", ["a"], [""]),
    (schema.TerrainSettings, {"dem": "a.tif"}, "extent", [[0, 0, 1, 1]], [[0, 0, 1], [0, 0, 0, 1], [0, 0, 1, 0], [0] * 5]),
    (schema.TerrainSettings, {"dem": "a.tif"}, "obstacles", [[{"polygons": "a", "height": 1}]], [[]]),
    (schema.TerrainSettings, {"dem": "a.tif"}, "friction_zones", [[{"polygons": "a", "factor": 1.5}]], [[]]),
    (schema.TerrainSettings, {"dem": "a.tif"}, "friction_rasters", [{"friction_angle_deg": "a"}], [{}, {"friction_angle_deg": ""}]),
    (schema.TerrainSettings, {"dem": "a.OBJ"}, "resolution", [5.0], [None, 0.0]),
    (schema.TerrainSettings, {"dem": "a.ply", "resolution": 5.0}, "overhang_friction_angle_deg", [None, 30.0], [-1.0, 0.3, 91.0]),
    (StructureSettings, {"file": "a.gpkg"}, "friction_angle_deg", [0.0, 30.0], [-1.0, 0.3, 91.0, None]),
    (schema.TerrainSettings, {"dem": "a.tif"}, "overhang_friction_angle_deg", [None], [30.0]),
    (HazardSettings, {}, "percentiles", [[1.0], [0.5, 99.9]], [[], [0.0, 5.0], [50.0, 100.0], [0.05, 0.5], [50, 5], [5, 5]]),
    (HazardSettings, {}, "thickness_thresholds", [[0.5]], [[], [0.0], [1.0, 0.5], [1.0, 1.0]]),
    (HazardSettings, {}, "speed_thresholds", [[], [0.1]], [[0.0], [2.0, 1.0]]),
    (HazardSettings, {}, "formats", ["all", "netcdf"], ["tif", None]),
    (HazardSettings, {}, "joint", [[{"thickness": 1, "speed": 1}]], [[], [{"thickness": 1}], [{}]]),
    (DifferenceSettings, {"raster": "a.tif"}, "detection_limit", [0.0, 100.0], [-0.1, 100.1]),
    (GaugeSettings, {"points": "a"}, "speed", ["v"], [None]),
    (OutlineSettings, {}, "polygons", ["a"], ["", None]),
    (OutlineSettings, {"polygons": "a"}, "shows", ["flow", "deposit"], ["both", None]),
    (DepositSettings, {}, "raster", ["a"], ["", None]),
    (GaugeSettings, {"thickness": "h"}, "points", ["a"], ["", None]),
    (ThalwegSettings, {}, "line", ["a"], ["", None]),
    (ProbeSettings, {}, "cross_sections", ["a"], ["", None]),
    (schema.ObstacleSettings, {"height": 3.0}, "polygons", ["a"], [""]),
    (schema.ZoneSettings, {"factor": 2.0}, "polygons", ["a"], [""]),
    (schema.ZoneSettings, {"polygons": "a"}, "factor", [2.0, "attribute"], [None, -1.0, ""]),
    (schema.ZoneSettings, {"polygons": "a", "factor": 2.0}, "basal_friction_angle_deg", [None], [30.0]),
    (StructureSettings, {}, "file", ["a.gpkg"], [""]),
    (StructureSettings, {"file": "a.gpkg"}, "protects", ["b"], [""]),
    (ProbeSettings, {"points": "a"}, "interval", [1e-6], [0.0]),
    (ProbeSettings, {}, "points", ["a", [{"name": "p", "x": 0, "y": 0}]], ["", [], None, [{"name": "", "x": 0, "y": 0}]]),
    (ProbeSettings, {"points": [{"name": "p", "x": 0, "y": 0}]}, "points_layer", [None], ["layer"]),
    (ProbeSettings, {"points": "a"}, "cross_sections_layer", [None], ["layer"]),
    (StructureSettings, MESH, "offset", [[1.0, 2.0, 3.0]], [[1.0, 2.0], [1.0] * 4, [1.0, 2.0, float("inf")]]),
    (StructureSettings, {"file": "a.gpkg"}, "name", ["a"], [""]),
    (StructureSettings, {"file": "house.obj"}, "units", ["m", "cm", "mm", "ft"], ["km", None]),
    (StructureSettings, {"file": "a.gpkg", "protects": "b.gpkg"}, "protects_layer", ["c"], [""]),
    (StructureSettings, {"file": "a.gpkg"}, "protects_layer", [None], ["c"]),
    (StructureSettings, MESH, "clearance", [5.0], ["attribute"]),
    (StabilitySettings, {}, "samples", [1, 2, 256], [0, 3, 255]),
    (StabilitySettings, {}, "sample_seed", [0], [-1]),
    (StabilitySettings, {}, "probability", [1e-6, 1.0], [0.0, 1.01]),
    (StabilitySettings, {}, "largest_drainage", [1e-6], [0.0]),
    (StabilitySettings, {}, "least_area", [1e-6], [0.0]),
    (StabilitySettings, {}, "most", [1], [0]),
    (StabilitySettings, {"saturation": 0.5}, "transmissivity_recharge", [], [2000.0]),
]  # fmt: skip


@pytest.mark.parametrize(
    ("stated", "support"),
    [
        ({"distribution": "uniform", "low": 1.0, "high": 3.0}, (1.0, 3.0)),
        ({"distribution": "triangular", "low": 1.0, "mode": 2.0, "high": 3.0}, (1.0, 3.0)),
        ({"distribution": "discrete", "values": [2.0, 3.0, 1.0], "frequencies": [1.0, 1.0, 2.0]}, (1.0, 3.0)),
        ({"distribution": "normal", "mean": 10.0, "standard_deviation": 2.0}, (2.0, 18.0)),  # four standard deviations
        ({"distribution": "normal", "mean": 10.0, "standard_deviation": 2.0, "low": 5.0}, (5.0, 18.0)),
        ({"distribution": "normal", "mean": 10.0, "standard_deviation": 2.0, "high": 12.0}, (2.0, 12.0)),
    ],
)
def test_a_distribution_knows_its_smallest_and_largest_value(stated, support):
    assert DISTRIBUTIONS[stated["distribution"]](**stated).support() == support


@pytest.mark.parametrize(
    ("model", "others", "key", "valid", "refused"), LIMITS, ids=[f"{m.__name__}-{key}" for m, _, key, *_ in LIMITS]
)
def test_values_at_the_limits_are_valid_and_those_beyond_are_refused(model, others, key, valid, refused):
    for value in valid:
        model(**others, **{key: value})
    for value in refused:
        with pytest.raises(ValidationError):
            model(**others, **{key: value})


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (None, "has no value"),
        (True, "true is a yes or no"),
        ({"a": 1}, "is a block"),
        ("ten", "'ten' is text"),
        ([1, 2], "[1, 2] is a list"),
        (3, "3 is a number"),
        (0.5, "0.5 is a number"),
        (datetime.date(2026, 1, 2), "2026-01-02 is a date"),
    ],
)
def test_messages_say_what_kind_a_value_is(value, words):
    assert shown(value) == words


def test_a_misspelt_word_gets_the_nearest_choice_or_all_of_them():
    assert nearest("Tapred", ["vertical", "Tapered"]) == "Tapered"
    assert nearest("xyz", ["vertical", "tapered"]) is None
    assert choice_fix("vertcal", ["vertical", "tapered"]) == "did you mean 'vertical'?"
    assert choice_fix(3, iter(["vertical", "tapered"])) == "choose one of vertical, tapered"


ONLY_ON_CPU = "cuda:0 with backend scan, which runs on the CPU only; set device: cpu, or backend: hash"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("device: cuda:0", f"device: {ONLY_ON_CPU}"),
        ("snapshots: 1", "snapshots: 1 is out of range; it must be at least 2 and at most 1000"),
        ("device: cpu0\n  backend: hash", "device: 'cpu0' cannot be used; cpu or cuda:0"),
        ("precision: float16", "precision: 'float16' is not known; did you mean 'float64'?"),
        ("threads: two", "threads: 'two' is text; a whole number is needed"),
        ("cfl: '0.5'", "cfl: '0.5' is text; a number is needed; remove the quotes"),
        ("arrival_threshold: 0.2 m", "arrival_threshold: '0.2 m' is text; a number is needed; write 0.2; the unit is always m"),
        ("particles_per_cell: [1, 1]", "particles_per_cell: a list of 2; 3 values are needed"),
    ],
)
def test_a_wrong_value_is_named_with_its_line_key_and_remedy(edited, text, said):
    assert problems(edited("  end_time: 30", f"  end_time: 30\n  {text}")) == [f"site.yaml:18: simulation.{said}"]


def test_an_empty_name_of_a_file_and_a_missing_key_have_a_remedy(edited):
    edited("    polygons: inputs/release.geojson", '    polygons: ""')
    assert problems(edited("  end_time: 30\n", "")) == [
        "site.yaml:8: release[0].polygons: is empty; write a name or remove the key",
        "site.yaml:15: simulation.end_time: required key is missing; add it: longest simulated time [s]",
    ]


@pytest.mark.parametrize("ends", [[0.0, 300.0, 200.0], [0.0, 200.0, 200.0]])
def test_ends_of_reaches_along_a_thalweg_rise(ends):
    assert DifferenceSettings(raster="dod.tif", reaches=sorted({*ends})).reaches == sorted({*ends})
    with pytest.raises(ValidationError, match=f"200 m follows {ends[1]:g} m"):
        DifferenceSettings(raster="dod.tif", reaches=ends)
