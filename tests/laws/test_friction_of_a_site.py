"""Friction laws in site.yaml: settings, samples, releases, zones and refusals derive from its declarations."""

import json
import math
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
import xarray as xr
from ramp_site import CELL, NORTH, SITE, WEST, write_site

import runout
from runout import VelocityWeakening
from runout.errors import ConfigError
from runout.model.parameters import parameter
from runout.physics.tensors import real
from runout.workflow.check import inspect
from runout.workflow.check_physics import least_friction

ROOT = Path(__file__).parents[2]
ANGLE = "basal_friction_angle_deg: 20"
SAMPLED = "    basal_friction_angle_deg: {distribution: uniform, low: 12, high: 22}\n"
BLOCK = "basal_friction: {law: velocity_weakening, static_friction: 0.3, dynamic_friction: 0.1}"
STATIC = "    basal_static_friction: {distribution: uniform, low: 0.2, high: 0.4}\n"
WEAK = SITE.replace(ANGLE, BLOCK).replace(SAMPLED, STATIC)
OWN = WEAK.replace("    placement: on_surface\n", "    placement: on_surface\n    basal_friction: {dynamic_friction: 0.2}\n")
ZONED = WEAK.replace(
    "  dem: inputs/dem.tif\n", "  dem: inputs/dem.tif\n  friction_zones:\n    - {polygons: inputs/zone.geojson, ZONE}\n"
)


def write_zone(folder):
    """A square of 100 m in the plain, with an attribute."""
    x, y = WEST + 30 * CELL, NORTH - 15 * CELL
    ring = [[x, y], [x + 100, y], [x + 100, y + 100], [x, y + 100], [x, y]]
    crs = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::32632"}}
    feature = {"type": "Feature", "properties": {"dynamic": 0.4}, "geometry": {"type": "Polygon", "coordinates": [ring]}}
    text = json.dumps({"type": "FeatureCollection", "crs": crs, "features": [feature]})
    (folder / "inputs" / "zone.geojson").write_text(text)


def test_settings_of_friction_derive_from_the_declarations_of_its_law(tmp_path):
    site = runout.read_site(write_site(tmp_path / "site", WEAK))
    arguments = site.member_arguments({"basal_static_friction": 0.25})
    assert arguments["basal_friction"] == VelocityWeakening(static_friction=0.25, dynamic_friction=0.1, weakening_speed=4.0)
    assert "basal_friction_angle" not in arguments
    assert "source" not in site.computed()["basal_friction"]  # results depend on the version of runout alone
    assert inspect(tmp_path / "site").problems == []
    assert least_friction(site, site.releases(site.terrain())) == pytest.approx(math.atan(0.1))


def test_the_default_law_may_be_named(tmp_path):
    site = runout.read_site(write_site(tmp_path / "site", SITE.replace(ANGLE, "basal_friction: {friction_angle_deg: 20}")))
    friction = site.member_arguments({"basal_friction_angle_deg": 15.0})["basal_friction"]
    assert (type(friction).__name__, friction.at_rest) == ("Coulomb", math.tan(math.radians(15.0)))


def test_a_release_replaces_parameters_of_every_member(tmp_path):
    site = runout.read_site(write_site(tmp_path / "site", OWN))
    (release,) = site.member_arguments({"basal_static_friction": 0.25})["release"]
    assert release.basal_friction == VelocityWeakening(static_friction=0.25, dynamic_friction=0.2, weakening_speed=4.0)
    assert least_friction(site, site.releases(site.terrain())) == pytest.approx(math.atan(0.2))


@pytest.mark.parametrize("stated", ["0.4", "dynamic"])
def test_zones_replace_parameters_by_number_or_attribute(tmp_path, stated):
    folder = write_site(tmp_path / "site", ZONED.replace("ZONE", f"basal_friction: {{dynamic_friction: {stated}}}"))
    write_zone(folder)
    site = runout.read_site(folder)
    zones = site.friction_zones(site.terrain())
    kept, own = zones.replaced["dynamic_friction"]
    assert (own.max(), kept.min(), zones.factor.min(), zones.factor.max()) == pytest.approx((0.4, 0.0, 1.0, 1.0))
    assert own.sum() * CELL**2 == pytest.approx(0.4 * 100**2)
    assert "dynamic_friction 0.4 to 0.4" in zones.statement()
    assert inspect(folder).problems == []


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            WEAK.replace("static_friction: 0.3", "static_friction: 3"),
            r"site.yaml:10: basal_friction.static_friction: 3 is out of range",
        ),
        (
            WEAK.replace("static_friction: 0.3", "static_frictio: 3"),
            "basal_friction.static_frictio: unknown key; did you mean 'static_fri",
        ),
        (
            WEAK.replace("velocity_weakening", "voellmi"),
            "basal_friction.law: 'voellmi' is not known; choose one of coulomb|did you mean",
        ),
        (WEAK.replace(BLOCK, f"{BLOCK}\n{ANGLE}"), "basal_friction: basal_friction_angle_deg is given too; remove one of the two"),
        (SITE.replace(ANGLE + "\n", ""), "basal_friction_angle_deg: required key is missing; add it: friction angle"),
        (WEAK.replace("low: 0.2", "low: -0.2"), "basal_static_friction: it can give -0.2; the parameter must be at least 0"),
        (
            WEAK.replace(STATIC, SAMPLED),
            "basal_friction_angle_deg: the friction law velocity_weakening has no such parameter; remove it",
        ),
        (
            OWN.replace("{dynamic_friction", "{dynamic_frictions"),
            r"release\[0\].basal_friction.dynamic_frictions: unknown key; did you mean",
        ),
        (
            OWN.replace("{dynamic_friction: 0.2}", "{dynamic_friction: 9}"),
            r"release\[0\].basal_friction.dynamic_friction: 9 is out of range",
        ),
        (
            OWN.replace("{dynamic_f", "{static_f"),
            r"release\[0\].basal_friction.static_friction: the ensemble samples this parameter too",
        ),
        (
            OWN.replace("basal_friction: {dynamic_friction: 0.2}", "basal_friction_angle_deg: 15"),
            r"release\[0\].basal_friction_angle_deg: the friction law velocity_weakening has no friction angle; write basal_fr",
        ),
        (ZONED.replace("ZONE", "factor: 2, basal_friction: {static_friction: 1}"), "factor and basal_friction are both given"),
        (
            ZONED.replace("ZONE", "basal_friction_angle_deg: 12"),
            r"friction_zones\[0\].basal_friction_angle_deg: the friction law velocity",
        ),
        (ZONED.replace("ZONE", "basal_friction: {static: 1}"), r"friction_zones\[0\].basal_friction.static: unknown key"),
    ],
)
def test_wrong_settings_of_friction_get_the_place_and_the_remedy(tmp_path, text, said):
    folder = write_site(tmp_path / "site", text)
    write_zone(folder)
    with pytest.raises(ConfigError, match=said):
        runout.read_site(folder)


def test_attributes_out_of_range_are_refused(tmp_path):
    folder = write_site(
        tmp_path / "site", ZONED.replace("ZONE", "basal_friction: {weakening_speed: dynamic, static_friction: none}")
    )
    write_zone(folder)
    site = runout.read_site(folder)
    with pytest.raises(runout.ZoneError, match=r"zone\.geojson: no attribute 'none' for the static_friction"):
        site.friction_zones(site.terrain())


def test_an_installed_friction_law_is_found_by_commands_and_workers(tmp_path, installed_friction):
    sampled = STATIC.replace("static_friction", "friction")
    text = SITE.replace(ANGLE, "basal_friction: {law: drag_by_load}").replace(SAMPLED, sampled)
    text = text.replace("members: 4", "members: 2").replace("end_time: 20", "end_time: 1, backend: reference")
    folder = write_site(tmp_path / "site", text)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(installed_friction), str(ROOT)])}
    command = [sys.executable, "-m", "runout", "ensemble", str(folder), "--workers", "2"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    paths = list((folder / "results" / "members").glob("*.nc"))
    assert len(paths) == 2
    for path in paths:
        with xr.open_dataset(path) as member:
            sampled = json.loads(member.attrs["parameters"])["basal_friction"]
            assert np.atleast_1d(member.attrs["basal_friction"]).tolist() == pytest.approx([sampled])
            assert 0.2 < sampled < 0.4


@dataclass(frozen=True, kw_only=True)
class Sound(runout.BasalFriction):
    """A law that holds together."""

    law: ClassVar[str] = "sound_friction"
    coefficients: ClassVar[tuple[str, ...]] = ("friction",)
    friction: float = parameter("something", low=0, high=1, typical=0.5)


def by_power(normal, slip, area, dt, basal):
    return basal.friction**2 * normal, real(0.0)


def of_two(normal, basal):
    return normal, real(0.0)


@pytest.mark.parametrize(
    ("resistance", "said"),
    [
        (by_power, r"by_power cannot be compiled: line \d+: \*\* with an integer does not compile in warp: multiply"),
        (of_two, r"resistance must be a plain function of \(normal, slip, area, dt, basal\)"),
    ],
)
def test_a_resistance_that_compilers_would_not_read_alike_is_refused(resistance, said):
    with pytest.raises(ConfigError, match=said):
        runout.register_friction(Sound, resistance)


def test_a_friction_law_needs_a_name_of_its_own_declared_parameters_and_a_coefficient():
    @dataclass(frozen=True, kw_only=True)
    class Clash(Sound):
        law: ClassVar[str] = "coulomb"

    @dataclass(frozen=True, kw_only=True)
    class Undeclared(Sound):
        law: ClassVar[str] = "undeclared"
        softness: float = 1.0

    @dataclass(frozen=True, kw_only=True)
    class Aimless(Sound):
        law: ClassVar[str] = "aimless"
        coefficients: ClassVar[tuple[str, ...]] = ("mu",)

    def resistance(normal, slip, area, dt, basal):
        return basal.friction * normal, real(0.0)

    for law, said in (
        (Clash, "have the same name; choose another one"),
        (Undeclared, r"softness is not declared; write softness: float = parameter\(\.\.\.\)"),
        (Aimless, "coefficients must name friction coefficients among friction"),
    ):
        with pytest.raises(ConfigError, match=said):
            runout.register_friction(law, resistance)
    with pytest.raises(ConfigError, match="friction is 2; it must be at least 0 and at most 1"):
        Sound(friction=2.0)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ([0.3, 0.4], r"polygons 1 \(dynamic_friction 0.3\) and 2 \(dynamic_friction 0.4\) overlap"),
        ([0.3, None], "polygon 2 is empty"),
    ],
)
def test_zones_that_do_not_fit_together_are_told_in_words(tmp_path, values, said):
    folder = write_site(tmp_path / "site", ZONED.replace("ZONE", "basal_friction: {dynamic_friction: dynamic}"))
    write_zone(folder)
    path = folder / "inputs" / "zone.geojson"
    content = json.loads(path.read_text())
    content["features"] = [{**content["features"][0], "properties": {"dynamic": value}} for value in values]
    path.write_text(json.dumps(content))
    site = runout.read_site(folder)
    with pytest.raises(runout.ZoneError, match=said):
        site.friction_zones(site.terrain())
