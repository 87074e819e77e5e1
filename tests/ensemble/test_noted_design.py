"""Sampled parameters: those of scipy, noted in the cache folder, and made again where the note is damaged or cannot be written."""

from dataclasses import dataclass

import numpy as np
import pytest

from runout.ensemble import design
from runout.ensemble.design import Design, sobol_points


@dataclass(frozen=True)
class Uniform:
    """A distribution as site.yaml states it."""

    low: float
    high: float
    distribution: str = "uniform"


@dataclass(frozen=True)
class Ensemble:
    """An ensemble as site.yaml states it."""

    members: int = 4
    seed: int = 1
    high: float = 2.0

    @property
    def parameters(self):
        return {"density": Uniform(1.0, self.high), "cohesion": Uniform(0.0, 1.0)}


@pytest.fixture
def made(tmp_path, monkeypatch):
    """Calls that made points, with an empty cache folder."""
    calls = []
    monkeypatch.setenv("RUNOUT_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(design, "sobol_points", lambda *given: calls.append(given) or sobol_points(*given))
    return calls


def test_points_are_those_of_scipy_bit_by_bit():
    from scipy.stats import qmc

    wanted = qmc.Sobol(3, scramble=True, bits=design.SOBOL_BITS, seed=7).random_base2(4)[:11] + 0.5**31
    np.testing.assert_array_equal(sobol_points(11, 3, 7), wanted)
    np.testing.assert_array_equal(sobol_points(16, 3, 7)[:11], wanted)
    assert sobol_points(5, 0, 1).shape == (5, 0)


def test_values_are_made_once_bit_by_bit_and_anew_for_another_ensemble(made):
    first = Design.of(Ensemble())
    assert list(first.values) == ["density", "cohesion"]
    assert Design.of(Ensemble()) == first
    assert len(made) == 1
    others = [Design.of(Ensemble(members=8)), Design.of(Ensemble(seed=2)), Design.of(Ensemble(high=3.0))]
    assert len(made) == 4
    assert others[0].values["density"][:4] == first.values["density"]
    assert first not in others


@pytest.mark.parametrize("damage", ["", "{", '{"value": 5}', "changed"])
def test_damaged_values_are_made_again(made, tmp_path, damage):
    wanted = Design.of(Ensemble())
    (file,) = (tmp_path / "cache").rglob("design-*.json")
    value = str(wanted.values["density"][0])
    file.write_text(file.read_text().replace(value, "1.25") if damage == "changed" else damage)
    assert Design.of(Ensemble()) == wanted
    assert len(made) == 2
    assert Design.of(Ensemble()) == wanted
    assert len(made) == 2


def test_values_are_made_where_the_cache_cannot_be_written_and_large_designs_are_not_noted(made, tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("RUNOUT_CACHE", str(tmp_path / "file"))
    assert Design.of(Ensemble()) == Design.of(Ensemble())
    assert len(made) == 2
    monkeypatch.setenv("RUNOUT_CACHE", str(tmp_path / "other"))
    monkeypatch.setattr(design, "MOST_NOTED", 7)
    Design.of(Ensemble())
    assert not (tmp_path / "other").exists()
