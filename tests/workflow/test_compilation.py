"""Kernels of a site are compiled from the start of a run on: those that its members will call."""

from pathlib import Path

import pytest

from runout.backends.scan import ahead
from runout.backends.scan.precompile import variant
from runout.config.site import read_site
from runout.errors import ConfigError
from runout.simulation.scenario import build_scene, scene_arguments
from runout.workflow import hazard_map
from runout.workflow.compilation import compile_ahead

JACKSBORO = Path(__file__).parents[2] / "sites" / "jacksboro"


@pytest.fixture
def compiled(monkeypatch):
    """Scenes whose kernels were asked for."""
    scenes = []
    monkeypatch.setattr(ahead, "ensure_compiled", lambda scene, sources: scenes.append(scene))
    return scenes


def kind(scene):
    """What the kernels of a scene depend on."""
    return scene.law, scene.basal.law, scene.precision, len(scene.materials) == 1, variant(scene)


def test_the_kernels_of_the_members_are_compiled(compiled):
    site = read_site(JACKSBORO)
    compile_ahead(site).wait(lambda fraction: None)
    arguments = site.member_arguments({"basal_friction_angle_deg": 15.0})
    scene = build_scene(**scene_arguments(arguments))[0]
    assert [kind(found) for found in compiled] == [kind(scene)]


def test_sites_on_a_gpu_compile_nothing_for_the_processor(compiled):
    site = read_site(JACKSBORO)
    simulation = site.settings.simulation.model_copy(update={"device": "cuda:0"})
    assert compile_ahead(site.with_settings(simulation=simulation)) is None
    assert not compiled


def test_compilation_starts_before_the_inputs_are_checked(monkeypatch, tmp_path):
    begun = []

    def checked(site):
        assert begun
        raise ConfigError("ends here")

    monkeypatch.setattr(hazard_map, "compile_ahead", begun.append)
    monkeypatch.setattr(hazard_map, "_inspected", checked)
    with pytest.raises(ConfigError, match="ends here"):
        hazard_map.run(JACKSBORO, tmp_path)
