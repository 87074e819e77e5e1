import pytest

from runout.config.material import sampled_ranges
from runout.config.parameter_variables import parameter_variable, udunits
from runout.errors import ConfigError
from runout.report.wording import unit


@pytest.mark.parametrize("name", sampled_ranges())
def test_each_parameter_that_an_ensemble_may_sample_has_a_column_in_tables_of_members(name):
    assert parameter_variable(name).attributes()["units"]


def test_units_of_parameters_are_those_of_their_laws():
    assert parameter_variable("basal_xi").attributes()["units"] == "m s-2"
    assert [udunits(one) for one in ("", "deg", "kg/m3", "1/m", "Pa")] == ["1", "degree", "kg m-3", "m-1", "Pa"]
    assert unit("m s-2") == "m s⁻²"


def test_parameter_that_no_law_has_is_named():
    with pytest.raises(ConfigError, match="basal_colour"):
        parameter_variable("basal_colour")
