"""Map quantities: their names, their formulas, and the peaks that are made of them. ``tests/recipes`` adds one."""

import ast
import inspect
import textwrap

import numba
import numpy as np
import pytest

from runout.backends.compile import numba_binding, rebound
from runout.model.registered_law import violations_in
from runout.quantities import QUANTITIES, member_map_names, peak_quantities, quantity_of
from runout.variables import VARIABLES


def test_every_quantity_of_the_table_is_described():
    assert next(iter(QUANTITIES)) == "thickness"
    for name, q in QUANTITIES.items():
        made = [q.member_map, q.percentile, q.peak, q.threshold, q.joint_threshold, *([q.mean] if q.mean else [])]
        made += [q.exceedance(kind) for kind in ("probability", "standard_error", "rms_error")]
        assert set(made) <= VARIABLES.keys(), name
        assert {VARIABLES[one].units for one in (q.member_map, q.percentile, q.peak, q.threshold)} == {q.units}
        assert all(quantity_of(one) is q for one in (q.member_map, q.percentile, q.peak))
        assert list(q.thresholds) == sorted(set(q.thresholds))
    assert set(member_map_names()) <= VARIABLES.keys()
    assert quantity_of("elevation") is None


@pytest.mark.parametrize("quantity", peak_quantities(), ids=lambda quantity: quantity.name)
def test_a_formula_is_read_by_numba_as_by_python(quantity):
    (tree,) = ast.parse(textwrap.dedent(inspect.getsource(quantity.formula))).body
    assert list(violations_in(tree)) == []
    compiled = numba.njit(rebound(quantity.formula, numba_binding(np.float64, False).names, {}))
    for column in ((0.2, 0.0, 1500.0), (3.7, 12.5, 2000.0), (40.0, 80.0, 2600.0)):
        assert compiled(*column) == pytest.approx(quantity.formula(*column), rel=1e-14)


def test_momentum_flux_is_the_peak_of_the_product_and_not_the_product_of_peaks():
    """Thick and slow, then thin and fast: the largest h v^2 is less than what the maxima would give."""
    from runout.backends.protocol import RasterSums
    from runout.model.scene import Raster
    from runout.simulation.observers import PeakMaps

    class Scene:
        raster = Raster(3, 4, (2.0, 2.0))

    peaks = PeakMaps(Scene(), 0.1)  # type: ignore[arg-type]
    for time, (h, v) in enumerate([(5.0, 1.0), (0.5, 6.0), (0.05, 90.0), (2.0, 2.0)]):
        volume = np.full((1, 1), 4.0 * h)
        momentum = 2000.0 * volume[..., None] * np.array([0.0, 0.6 * v, 0.8 * v])
        peaks.observe(float(time), RasterSums(volume, 2000.0 * volume, momentum, 1, 2))
    maps = {name: values[1, 2] for name, values in peaks.maps().items()}
    assert maps["max_momentum_flux"] == pytest.approx(0.5 * 6.0**2), "the third look is thinner than the threshold of arrival"
    assert maps["max_momentum_flux"] < maps["max_flow_thickness"] * maps["max_speed"] ** 2
    assert maps["max_pressure"] == pytest.approx(2000.0 * 6.0**2)
