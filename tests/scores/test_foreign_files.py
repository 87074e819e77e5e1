import numpy as np
import pytest
import xarray as xr

from runout.errors import ObservationError
from runout.scores.products import Reading, read_product


@pytest.mark.parametrize("dimensions", [("x", "y"), ("time", "y", "x")])
def test_map_of_another_tool_with_other_dimensions_is_no_member(tmp_path, dimensions):
    sizes = {"x": 4, "y": 3, "time": 2}
    values = np.zeros([sizes[name] for name in dimensions])
    coordinates = {name: np.arange(sizes[name]) for name in dimensions}
    xr.Dataset({"max_flow_thickness": (dimensions, values)}, coordinates).to_netcdf(tmp_path / "map.nc")
    with pytest.raises(ObservationError, match="is neither hazard"):
        read_product(tmp_path / "map.nc", Reading())
