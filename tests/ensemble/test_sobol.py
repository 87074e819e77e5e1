"""Sobol points of an ensemble: those of scipy, kept in the cache folder, and made again where that is damaged or closed."""

import numpy as np
import pytest

from runout.ensemble import sobol


@pytest.fixture
def made(tmp_path, monkeypatch):
    """Calls that made points, with an empty cache folder."""
    calls, make = [], sobol._made
    monkeypatch.setenv("RUNOUT_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(sobol, "_made", lambda *given: calls.append(given) or make(*given))
    return calls


def test_points_are_those_of_scipy_bit_by_bit_made_or_kept(made):
    from scipy.stats import qmc

    wanted = qmc.Sobol(3, scramble=True, bits=sobol.SOBOL_BITS, seed=7).random_base2(4)[:11] + 0.5**31
    for _ in range(3):
        np.testing.assert_array_equal(sobol.sobol_points(11, 3, 7), wanted)
    assert made == [(4, 3, 7)]
    np.testing.assert_array_equal(sobol.sobol_points(16, 3, 7)[:11], wanted)
    assert len(made) == 1  # the same file


def test_other_seeds_and_dimensions_have_points_of_their_own(made):
    found = [sobol.sobol_points(8, d, seed) for d, seed in ((2, 1), (2, 2), (3, 1))]
    assert len(made) == 3
    assert not np.array_equal(found[0], found[1])
    assert sobol.sobol_points(5, 0, 1).shape == (5, 0)
    assert len(made) == 3


@pytest.mark.parametrize("damage", ["", "{", '{"points": [[0.5, 0.5]]}', "changed"])
def test_damaged_points_are_made_again(made, tmp_path, damage):
    wanted = sobol.sobol_points(4, 2, 1)
    (file,) = (tmp_path / "cache").glob("sobol-*.json")
    file.write_text(file.read_text().replace("0.", "0.1", 1) if damage == "changed" else damage)
    np.testing.assert_array_equal(sobol.sobol_points(4, 2, 1), wanted)
    assert len(made) == 2
    sobol.sobol_points(4, 2, 1)
    assert len(made) == 2


def test_points_are_made_where_the_cache_cannot_be_written_and_large_sets_are_not_kept(made, tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("RUNOUT_CACHE", str(tmp_path / "file"))
    assert [sobol.sobol_points(4, 2, 1).shape for _ in range(2)] == [(4, 2)] * 2
    assert len(made) == 2
    monkeypatch.setenv("RUNOUT_CACHE", str(tmp_path / "other"))
    monkeypatch.setattr(sobol, "MOST_KEPT", 15)
    sobol.sobol_points(8, 2, 1)
    assert not (tmp_path / "other").exists()
