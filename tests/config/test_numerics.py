"""The choices of a run stand in one record; arguments of Python, settings of site.yaml and the scene have the same ones."""

import inspect
from dataclasses import MISSING, fields

import pytest

from runout import read_site, simulate
from runout.config.schema import SimulationSettings
from runout.errors import ConfigError, StabilityError
from runout.model.limits import CFL
from runout.model.numerics import Numerics, Scheme
from runout.model.scene import Scene
from runout.simulation.batch import simulate_batch
from runout.simulation.scenario import scene_arguments

CHOICES = {f.name: f.default for f in fields(Numerics)}
FROM_ACCURACY = {"cell_size": None}  # the argument that None leaves to the argument accuracy


def test_every_choice_is_an_argument_with_the_same_default():
    arguments = inspect.signature(simulate).parameters
    defaults = {name: arguments[name].default for name in CHOICES}
    assert defaults == CHOICES | FROM_ACCURACY
    assert CHOICES["cell_size"] is MISSING
    assert CHOICES["cfl"] == CFL


def test_every_choice_is_a_setting_with_the_same_default_but_the_seed_which_each_member_has():
    settings = {name: field.default for name, field in SimulationSettings.model_fields.items()}
    assert {name: settings[name] for name in CHOICES if name != "seed"} | {"seed": 0} == CHOICES | {"cell_size": None}


@pytest.mark.parametrize(
    ("name", "stated", "value"),
    [
        ("precision", "precision: float64", "float64"), ("cfl", "cfl: 0.4", 0.4), ("substeps", "substeps: 4", 4),
        ("initial_stress", "initial_stress: none", "none"),
        ("particles_per_cell", "particles_per_cell: [2, 2, 2]", (2, 2, 2)),
    ],
)  # fmt: skip
def test_a_choice_of_site_yaml_reaches_the_record(edited, name, stated, value):
    site = read_site(edited("end_time: 30", f"end_time: 30\n  {stated}"))
    assert getattr(scene_arguments(site.member_arguments({}))["numerics"], name) == value


def test_the_scene_takes_the_scheme():
    assert Scheme.names() < {f.name for f in fields(Scene)}
    assert set(Scheme().of_kernels()) == Scheme.names() - {"cfl"}


@pytest.mark.parametrize(
    ("choices", "message"),
    [
        ({"cfl": "fast"}, "cfl is 'fast'; it must be a number, 0.6 is usual"),
        ({"cfl": 0.7}, "cfl is 0.7; an isolated particle is unstable above 0.6, use 0.6"),
        ({"precision": "half"}, "precision is 'half'; choose float32 or float64"),
    ],
)
def test_choices_that_cannot_be_are_refused_with_their_remedy(choices, message):
    with pytest.raises((ConfigError, StabilityError), match=message):
        Numerics(cell_size=5.0, **choices)


def test_a_scenario_with_an_argument_that_simulate_does_not_have_is_refused(edited):
    arguments = read_site(edited("end_time: 30", "end_time: 1")).member_arguments({})
    with pytest.raises(TypeError, match=r"the argument 'cell_sise', which runout\.simulate does not have"):
        list(simulate_batch([arguments | {"cell_sise": 2.0}], device="cpu"))
