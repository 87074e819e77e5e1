"""Block ``stability`` of site.yaml: equal to the options of suggest-release, which go before it; problems with their line."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[1] / "workflow"))
from ramp_site import SITE, write_site

from runout import cli
from runout.config.site import read_site
from runout.errors import ConfigError
from runout.slopes.choices import PatchChoices, Strength
from runout.slopes.infinite_slope import assumptions, resolved, sampled

BLOCK = """
stability:
  cohesion: {distribution: uniform, low: 100, high: 2000}
  friction_angle_deg: {distribution: normal, mean: 34, standard_deviation: 3, low: 28, high: 42}
  soil_thickness: 1.2
  saturation: {distribution: uniform, low: 0.2, high: 0.9}
  samples: 512
  least_area: 300
"""
LINE = len(SITE.splitlines()) + 2  # of `stability:`


def stated(tmp_path, text):
    return read_site(write_site(tmp_path / "site", SITE + text))


def test_the_block_equals_the_options(tmp_path):
    block = stated(tmp_path, "\nstability:\n  cohesion: {distribution: uniform, low: 0, high: 500}\n  most: 3\n").settings.stability
    options = resolved(Strength(cohesion=(0.0, 500.0)), PatchChoices(most=3))
    assert resolved(settings=block) == options
    np.testing.assert_array_equal(sampled(resolved(settings=block)), sampled(options))
    assert resolved().cohesion.high == 4900.0


def test_samples_follow_their_distributions_and_options_go_first(tmp_path):
    block = stated(tmp_path, BLOCK).settings.stability
    cohesion, friction, thickness, water = sampled(resolved(settings=block))
    assert len(cohesion) == 512
    assert np.degrees(np.arctan(friction)).mean() == pytest.approx(34.1, abs=0.2)
    assert (thickness == 1.2).all()
    assert (water.min(), water.max()) == (pytest.approx(0.2, abs=0.01), pytest.approx(0.9, abs=0.01))
    over = resolved(Strength(transmissivity_recharge=(100.0, 200.0)), PatchChoices(least_area=50.0), block)
    assert over.saturation is None
    assert (over.least_area, over.samples) == (50.0, 512)


def test_what_nobody_stated_is_called_an_assumption(tmp_path):
    said = assumptions(resolved(Strength(cohesion=(0.0, 100.0))))
    assert said.startswith("assumed, not values of this place: friction angle 30 to 45 deg, soil thickness 0.5 to 1.5 m")
    assert "cohesion" not in said
    block = stated(tmp_path, BLOCK + "  soil_density: 1900\n").settings.stability
    assert assumptions(resolved(settings=block)) == ""


@pytest.mark.parametrize(
    ("change", "line", "said"),
    [
        (("low: 100, high: 2000", "low: 100, high: -2"), 1, "exchange them"),
        (("low: 100", "low: -100"), 1, "it can give -100 Pa"),
        (("mean: 34, standard_deviation: 3, low: 28, high: 42", "mean: 0.6, standard_deviation: 0.1"), 2, "degrees here"),
        (("friction_angle_deg", "friction_angle"), 2, "friction_angle_deg"),
        (("soil_thickness: 1.2", "soil_thickness: 0"), 3, "at least 0.01 m"),
        (("samples: 512", "samples: 500"), 5, "no power of two"),
        (("samples: 512", "transmissivity_recharge: 100"), 5, "has no meaning with saturation"),
        (("least_area: 300", "least_area: .nan"), 6, "least_area"),
    ],
)
def test_problems_name_line_key_and_remedy(tmp_path, change, line, said):
    with pytest.raises(ConfigError, match=rf"site.yaml:{LINE + line}: stability.*{said}"):
        stated(tmp_path, BLOCK.replace(*change))


def test_the_command_says_what_it_assumed(tmp_path, capsys):
    site = write_site(tmp_path / "site", SITE + BLOCK)
    assert cli.main(["-q", "--out", str(tmp_path), "suggest-release", str(site)]) == 0
    assert "assumed, not values of this place: soil density 2000 kg m-3; state yours" in capsys.readouterr().out
