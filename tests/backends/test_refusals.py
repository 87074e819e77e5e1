"""What no backend does: steps that are too long, scenes that are too large. Each refusal names the limit and its reason."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import ROCK, at, box, loaded, scene

from runout import Elastic
from runout.backends.protocol import get_backend
from runout.errors import CapacityError, StabilityError
from runout.model.limits import CFL, LARGEST_CFL
from runout.model.scene import RESERVE, STEP_TOLERANCE, Scene

UNIT = (1.0, 1.0, 1.0)


def still(backend):
    return loaded(backend, scene(), box((20.0, 20.0, 10.0), (2.0, 2.0, 2.0), UNIT))


def test_a_step_above_the_acoustic_limit_is_refused_with_the_limit_and_the_reason(backend):
    still(backend)
    limit = LARGEST_CFL / ROCK.wave_speed
    before = backend.particles().position(np.ones(3))
    with pytest.raises(StabilityError) as refused:
        backend.step(1.05 * limit)
    text = str(refused.value)
    assert f"a pressure wave of {ROCK.wave_speed:.4g} m/s would cross 0.63 cells in step 1 of {1.05 * limit:.4g} s" in text
    assert f"the acoustic limit is {limit:.4g} s (0.6 cells of 1 m)" in text
    assert f"take {backend.stable_step():.4g} s or less" in text
    assert (backend.particles().position(np.ones(3)) == before).all()  # nothing has moved
    assert backend.counters.steps == 0


def test_twice_the_step_that_the_backend_names_is_refused(backend):
    still(backend)
    with pytest.raises(StabilityError, match="acoustic limit"):
        backend.step(2.0 * backend.stable_step())


def test_a_step_above_the_particle_limit_is_refused_with_that_reason(backend):
    p = box((20.0, 20.0, 10.0), (2.0, 2.0, 2.0), UNIT)
    p.velocity[:, 0] = 200.0  # so much faster than the waves that the half cell limits
    fast = loaded(backend, scene(cfl=0.6), p)
    assert fast.stable_step() == pytest.approx(0.5 / 200.0)
    with pytest.raises(StabilityError, match=r"a particle of 200 m/s would cross 0\.525 cells .* the particle limit is 0\.0025 s"):
        fast.step(1.05 * fast.stable_step())


def test_a_stable_step_that_carries_a_particle_across_a_cell_is_reported_all_the_same(backend):
    """Gravity that no step can foresee: 1 km/s in one step."""
    loaded(backend, scene(gravity=(0.0, 0.0, -1e5)), at([(30.0, 30.0, 1.0)], UNIT))
    with pytest.raises(StabilityError, match=r"moved .* cells in step 1"):
        backend.step(backend.stable_step())


@pytest.mark.parametrize("dt", [0.0, -1e-3, float("nan")])
def test_a_step_that_is_not_positive_is_refused(backend, dt):
    with pytest.raises(StabilityError, match="it must be positive"):
        still(backend).step(dt)


def test_a_step_at_the_limit_is_taken_and_so_is_one_that_was_chosen_a_moment_ago(backend):
    loaded(backend, scene(cfl=LARGEST_CFL), box((20.0, 20.0, 10.0), (2.0, 2.0, 2.0), UNIT))
    backend.step(backend.stable_step())
    backend.step((1 + 0.9 * (STEP_TOLERANCE - 1)) * backend.stable_step())
    assert backend.counters.steps == 2


@pytest.mark.parametrize("spacing", [(1.0, 1.0, 1.0), (8.0, 4.0, 2.0)])
def test_particles_beyond_the_index_are_refused_with_the_largest_extent(backend, spacing):
    far = 1.5 * 2**22 * np.array(spacing)
    with pytest.raises(CapacityError) as refused:
        loaded(backend, scene(spacing=spacing), at([spacing, (spacing[0], spacing[1] + far[1], spacing[2])], spacing))
    text = str(refused.value)
    assert f"beyond the index range, {far[1]:.7g} m from where blocks are counted (north-south)" in text
    assert f"the largest admissible extent is {(2**22 - 16) * spacing[1]:.7g} m with cells of {spacing[1]:g} m" in text
    assert "use larger cells" in text


def growth_of_a_lone_particle(monkeypatch, poisson_ratio, share):
    """Growth of the strain of an elastic particle, alone and half way between nodes, in 60 steps of ``share`` of the largest."""
    monkeypatch.setattr(Scene, "require_stable", lambda *_: None)
    rock = Elastic(density=1000.0, youngs_modulus=1e7, poisson_ratio=poisson_ratio)
    p = at([(20.4999, 20.4999, 20.4999)], UNIT, rock.density, 1.0)
    p.strain[:, :3] = 1e-8
    free = scene(materials=(rock,), gravity=(0.0, 0.0, 0.0))
    engine = loaded(get_backend("reference"), free, p)
    for _ in range(60):
        engine.step(share * free.largest_cfl / rock.wave_speed)
    return np.abs(engine.particles().strain).max() / 1e-8


@pytest.mark.parametrize(("poisson_ratio", "largest"), [(0.48, 0.593), (0.49, 0.585)])
def test_an_isolated_particle_is_stable_up_to_its_courant_number(monkeypatch, poisson_ratio, largest):
    rock = Elastic(density=1000.0, youngs_modulus=1e7, poisson_ratio=poisson_ratio)
    assert scene(materials=(rock,)).largest_cfl == pytest.approx(largest, abs=5e-4)
    assert growth_of_a_lone_particle(monkeypatch, poisson_ratio, 0.97) < 5
    assert growth_of_a_lone_particle(monkeypatch, poisson_ratio, 1.03) > 1e5


def test_steps_are_shortened_where_an_isolated_particle_would_be_unstable():
    rock = Elastic(density=1000.0, youngs_modulus=1e7, poisson_ratio=0.49)
    stiff, shortened = (scene(materials=(replace(rock, poisson_ratio=ratio),)) for ratio in (0.3, 0.49))
    assert stiff.stable_step(0.0) == pytest.approx(CFL / stiff.wave_speed)
    assert shortened.stable_step(0.0) == pytest.approx(RESERVE * shortened.largest_cfl / rock.wave_speed)
    assert shortened.largest_cfl < CFL == stiff.largest_cfl
