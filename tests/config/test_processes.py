"""Published values of processes: every law and range makes a valid site, and each value has a source in the file."""

import re

import pytest
from conftest import write_inputs

from runout import cli
from runout.config.material import sampled_ranges
from runout.config.process_ranges import CHECKED, processes
from runout.config.read import load
from runout.config.scaffold import commented_yaml, new_site
from runout.config.schema import SiteSettings

VARIANTS = [(name, number) for name, p in processes().items() for number in (None, *range(len(p.others)))]


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    return write_inputs(tmp_path_factory.mktemp("inputs"))


@pytest.fixture(scope="module")
def made(inputs, tmp_path_factory):
    """A function: the folder of a new site of a process; made once."""
    folder = tmp_path_factory.mktemp("sites")

    def site(name):
        if not (folder / name).exists():
            new_site(folder / name, inputs / "dem.asc", inputs / "release.geojson", process=name)
        return folder / name

    return site


@pytest.mark.parametrize(("name", "other"), VARIANTS)
def test_every_law_of_every_process_passes_check(made, capsys, name, other):
    folder = made(name)
    if other is not None:
        plain = load(folder).model_dump(mode="json", exclude_none=True)
        plain["release"] = plain["release"][0]
        changed = processes()[name].applied(plain, other)
        changed["release"] = [changed["release"]]
        folder = folder.with_name(f"{name}_{other}")
        write_inputs(folder / "inputs")
        (folder / "site.yaml").write_text(commented_yaml(SiteSettings.model_validate(changed)), encoding="utf-8")
    assert cli.main(("check", str(folder))) == 0
    assert "members   8 to simulate" in capsys.readouterr().out


@pytest.mark.parametrize("name", processes())
def test_typical_values_are_settings_ranges_are_sampled_and_sources_stand_beside_them(made, name):
    text = (made(name) / "site.yaml").read_text(encoding="utf-8")
    settings = load(made(name)).model_dump(exclude_none=True)
    sampled = settings["ensemble"]["parameters"]
    joined = re.sub(r"\n *# ", " ", text)
    for r in processes()[name].variant.ranges:
        blocks, key = r.block
        block = settings
        for step in blocks:
            block = block[step][0] if step == "release" else block[step]
        assert block[key] == r.typical
        assert r.words() in joined
        if len(r.values) == 3:
            assert (sampled[r.key]["low"], sampled[r.key]["high"]) == (r.values[0], r.values[2])
    assert "not calibrated to this site" in settings["description"]
    for other in processes()[name].others:
        assert all(f"# {r.key}" in text and r.words() in joined for r in other.ranges)


@pytest.mark.parametrize(("name", "other"), VARIANTS)
def test_published_values_are_ordered_valid_and_say_whether_they_were_checked(name, other):
    p = processes()[name]
    ranges = (p.variant if other is None else p.others[other]).ranges
    assert ranges
    for r in ranges:
        assert r.values == sorted(r.values)
        assert len(r.values) in (1, 3)
        assert all(map(sampled_ranges()[r.key].holds, r.values)), r.key
        assert r.checked in CHECKED
        assert r.source


def test_an_unknown_process_is_refused_with_the_names_before_anything_is_made(inputs, tmp_path, capsys):
    tokens = ("new", str(tmp_path / "site"), "--dem", str(inputs / "dem.asc"), "--release", str(inputs / "release.geojson"))
    assert cli.main((*tokens, "--process", "debris_flw")) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "--process debris_flw: there is no such process; choose one of rock_avalanche, " in said
    assert all(name in said for name in processes())
    assert not (tmp_path / "site").exists()


def test_help_names_every_process(capsys):
    assert cli.main(("new", "--help")) == 0
    said = re.sub(r"[\s│]+", "", capsys.readouterr().out)
    assert all(name in said for name in processes())


def test_a_thickness_raster_gets_the_pore_pressure_of_its_process(inputs, tmp_path):
    site = new_site(tmp_path / "site", "matplotlib:jacksboro_fault_dem", inputs / "dem.asc", process="hillslope_debris_flow")
    (release,) = load(site).release
    assert release.raster == "inputs/release.asc"
    assert release.pore_pressure.ratio == 0.7
