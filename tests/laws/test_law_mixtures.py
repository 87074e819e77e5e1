"""Several laws in one run: what a mixture computes by record is what each law computes alone."""

from dataclasses import dataclass, replace
from typing import ClassVar

import drag_by_load
import numpy as np
import pytest
import quadratic_flow
from callers import plain, through_numba, through_warp
from parity_cases import law_cases

from runout import BasalFriction, Coulomb, DruckerPrager, Elastic, HerschelBulkley, Material, Voellmy, VoellmyBase
from runout.errors import ConfigError, MaterialError
from runout.model.basal_friction import MassAbove
from runout.model.basal_strength import unchanged
from runout.model.friction import FrictionZones
from runout.model.friction_laws import FRICTIONS, FrictionLaw
from runout.model.ground_friction import GroundFriction
from runout.model.law_mixtures import friction_law, material_law
from runout.model.laws import LAWS, Law, law_of
from runout.model.parameters import parameter
from runout.physics import contact

LAWS_OF_MATERIAL = (*LAWS.of_runout(), LAWS.find("quadratic_flow"))
EVERY = material_law(LAWS_OF_MATERIAL)
SOME = material_law(map(LAWS.find, ("drucker_prager", "elastic", "modified_cam_clay", "quadratic_flow")))
COMPILED = "step_small", "effective_step"  # of the cases, the others are made alike
GROUND = friction_law([*FRICTIONS.of_runout(), FRICTIONS.find("drag_by_load")])
MASS = MassAbove(0.5, 2000.0, 9.81)


def cases_of(mixture):
    """Each case of a mixture with the record of each of its laws, and the same case of that law alone."""
    for case in law_cases(mixture):
        for part, law in enumerate(mixture.laws):
            (alone,) = (c for c in law_cases(law) if c.function.__name__ == case.function.__name__)
            yield replace(case, part=part), alone


def require_same_bits(found, pair):
    """Results of a mixture are those of the law alone.

    Small steps end with the square that tells whether strain is small; for a material that never yields a mixture takes the larger
    of two bounds, that of laws that yield.
    """
    expected = plain(pair[1], pair[1].sample())
    if name_of(pair) == "elastic-step_small":
        assert np.all(found[:, -1] >= expected[:, -1])
        found, expected = found[:, :-1], expected[:, :-1]
    np.testing.assert_array_equal(found, expected)


def name_of(pair):
    return f"{pair[1].law.name}-{pair[1].function.__name__}" if isinstance(pair, tuple) else None


@pytest.mark.parametrize("pair", [*cases_of(EVERY), *cases_of(GROUND)], ids=name_of)
def test_a_mixture_takes_the_bits_of_the_law_of_a_record(pair):
    require_same_bits(plain(pair[0], pair[0].sample()), pair)


@pytest.mark.parametrize("compiled", [through_numba, through_warp])
@pytest.mark.parametrize("pair", [p for p in cases_of(SOME) if p[1].function.__name__ in COMPILED], ids=name_of)
def test_compilers_take_the_same_bits_of_materials(pair, compiled):
    require_same_bits(compiled(pair[0], pair[0].sample(), np.float64), pair)


@pytest.mark.parametrize("compiled", [through_numba, through_warp])
@pytest.mark.parametrize("pair", cases_of(GROUND), ids=name_of)
def test_compilers_take_the_same_bits_of_friction(pair, compiled):
    require_same_bits(compiled(pair[0], pair[0].sample(), np.float64), pair)


def test_the_order_of_releases_does_not_change_what_is_compiled():
    assert material_law(LAWS_OF_MATERIAL[::-1]) is EVERY
    assert material_law([*LAWS_OF_MATERIAL, LAWS_OF_MATERIAL[0]]) is EVERY
    assert material_law([LAWS_OF_MATERIAL[0]] * 3) is LAWS_OF_MATERIAL[0]  # one law is no mixture
    assert friction_law(GROUND.laws[::-1]) is GROUND


def test_a_table_holds_the_numbers_of_each_law():
    sand = DruckerPrager(youngs_modulus=2e6, friction_angle=30.0)
    mud = HerschelBulkley(youngs_modulus=3e6, yield_stress=900.0, consistency=7.0)
    law = material_law(map(law_of, (mud, sand)))
    table = law.table((mud, sand, mud), np.float32)
    law.set_step(table, 1e-3)
    for row, material in zip(table, (mud, sand, mud), strict=True):
        for name, value in (material.record() | ({"time_step": 1e-3} if material is mud else {})).items():
            assert row[name] == np.float32(value)
    assert [law.laws[int(n)].name for n in table["law_number"]] == ["herschel_bulkley", "drucker_prager", "herschel_bulkley"]


def test_zones_change_the_numbers_of_each_law():
    factor, none = np.ones((2, 2)), np.zeros((2, 2))
    factor[1] = 1.5
    outside = (factor == 1.0).astype(float)
    zones = FrictionZones(factor, none, (1.0, 1.0), replaced={"inverse_xi": (outside, 0.002 * (1.0 - outside))})
    ground = GroundFriction([Voellmy(mu=0.2, xi=500.0), 0.3, Voellmy(mu=0.1, xi=1000.0)], [MASS] * 3, zones)
    alone = [GroundFriction([f], [MASS], zones) for f in (Voellmy(mu=0.2, xi=500.0), Voellmy(mu=0.1, xi=1000.0))]
    table = ground.table().reshape(3, 2)
    for row, one in zip(table[::2], alone, strict=True):
        for name in one.law.fields:
            np.testing.assert_array_equal(row[name], one.table()[name])
    np.testing.assert_allclose(table["friction"][1], [0.3, 0.45])
    np.testing.assert_allclose(ground.at_rest(), [0.2, 0.3, 0.3, 0.45, 0.1, 0.15])


def test_a_parameter_of_the_ground_that_a_law_lacks_is_named_and_one_that_none_has_is_refused():
    zones = FrictionZones(
        np.ones((2, 2)), np.zeros((2, 2)), (1.0, 1.0), gridded={"inverse_xi": (np.zeros((2, 2)), np.ones((2, 2)))}
    )
    said = list(unchanged([Voellmy(mu=0.2, xi=500.0), 0.3], ["wet", "dry"], zones))
    assert said == ["dry: the ground states xi, which its friction law coulomb does not have; it has no effect on it"]
    with pytest.raises(ConfigError, match="a raster states inverse_xi, and friction law coulomb has friction; state parameters"):
        GroundFriction([0.3], [MASS], zones)


def test_a_friction_angle_of_a_zone_is_refused_where_a_law_has_none():
    zones = FrictionZones(np.zeros((2, 2)), np.full((2, 2), 0.4), (1.0, 1.0), source="zones.gpkg")
    with pytest.raises(ConfigError, match=r"zones\.gpkg: a zone states a friction angle, and friction law voellmy has mu"):
        GroundFriction([0.3, Voellmy(mu=0.2, xi=500.0)], [MASS] * 2, zones)


def test_drag_acts_on_the_column_or_at_the_base_as_each_law_means_it():
    ground = friction_law([FRICTIONS.find("voellmy"), FRICTIONS.find("voellmy_base"), FRICTIONS.find("coulomb")])
    frictions = [Voellmy(mu=0.2, xi=500.0), VoellmyBase(mu=0.2, xi=500.0), Coulomb(friction_angle=20.0)]
    basal = GroundFriction(frictions, [MASS] * 3, None)
    assert basal.law is ground
    rows = basal.table().view(np.recarray)
    at_base = [ground.at_base(1.0, 5.0, 2.0, 0.01, row)[1] for row in rows]
    on_column = [ground.column_drag((0.0, 0.0, 1.0), (5.0, 0.0, 0.0), (0.0, 0.0, 1.0), 2.0, 0.1, 9.81, 0.01, row) for row in rows]
    drag = 2.0 * 2000.0 * 9.81 / 500.0
    assert at_base == pytest.approx([0.0, drag, 0.0])
    assert on_column == pytest.approx([drag, 0.0, 0.0])
    assert basal.limits_start.tolist() == [True, True, False]


@dataclass(frozen=True, kw_only=True)
class Numbered(Material):
    """A material whose record has the name of the number of the law."""

    law: ClassVar[str] = "numbered"

    def record(self):
        return super().record() | {"law_number": 1.0}


@dataclass(frozen=True, kw_only=True)
class NumberedGround(BasalFriction):
    """Friction likewise."""

    law: ClassVar[str] = "numbered_ground"
    coefficients: ClassVar[tuple[str, ...]] = ("law_number",)
    law_number: float = parameter("coefficient", low=0, high=1, default=0.3)


def test_a_law_with_the_name_of_its_number_is_refused_beside_another():
    laws = law_of(Elastic()), Law("numbered", Numbered, None)
    with pytest.raises(MaterialError, match=r"law numbered has a number law_number.*; rename it"):
        material_law(laws)
    ground = FrictionLaw("numbered_ground", NumberedGround, contact.law_resistance)
    with pytest.raises(ConfigError, match="law numbered_ground has a number law_number"):
        friction_law([ground, FRICTIONS.find("coulomb")])


def test_a_mixture_with_a_law_of_another_package_states_its_source():
    assert EVERY.source == EVERY.fingerprint != ""
    assert material_law(map(LAWS.find, ("drucker_prager", "elastic"))).source == ""
    assert quadratic_flow.__name__ in EVERY.name
    assert drag_by_load.__name__ in GROUND.name
