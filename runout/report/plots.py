"""Maps of a terrain, a release and a result over hillshade, on figures of pyplot: ``terrain.plot()`` and so on."""

from typing import TYPE_CHECKING, Any

import numpy as np

from runout.errors import ConfigError
from runout.quantities import ARRIVAL, QUANTITIES
from runout.report.maps import Basemap, blank_map, tint_by_elevation
from runout.report.values import STYLES, MapStyle, Window, draw_values
from runout.report.wording import unit
from runout.variables import VARIABLES

if TYPE_CHECKING:
    from runout.model.release import Release
    from runout.model.terrain import Terrain
    from runout.simulation.result import Result

TIME = "arrival"  # name of the map of arrival


def plot_terrain(terrain: "Terrain", *, title: str = "") -> Any:
    """Axes with a map of the elevation."""
    from matplotlib import pyplot

    basemap = _basemap(terrain)
    axes, bar = blank_map(basemap, basemap.whole, title, pyplot.figure)
    tint_by_elevation(axes, bar, basemap)
    pyplot.sca(axes)
    return axes


def plot_release(release: "Release", *, title: str | None = None) -> Any:
    """Axes with a map of the thickness around the release."""
    basemap = _basemap(release.terrain, [] if release.outline is None else [release.outline])
    window = basemap.window(release.thickness > 0, margin=0.6)
    style = STYLES["thickness"]
    named = f"{release.name}: {release.volume:.4g} {unit('m3')}" if title is None else title
    return _drawn(basemap, window, release.thickness, style, named)


def plot_result(result: "Result", quantity: str = "thickness", *, title: str | None = None) -> Any:
    """Axes with a map of a quantity around the cells that the flow reached.

    Raises ConfigError if there is no such quantity.
    """
    known = {name: row.member_map for name, row in QUANTITIES.items()} | {TIME: ARRIVAL}
    if quantity not in known:
        raise ConfigError(f"quantity is {quantity!r}; choose one of {', '.join(known)}")
    basemap, name = _basemap(result.terrain), known[quantity]
    reached = np.nan_to_num(result.fields[QUANTITIES["thickness"].member_map]) > 0
    values = result.terrain.where_known(result.fields[name])
    style = STYLES["time" if quantity == TIME else quantity]
    words = VARIABLES[name].long_name
    return _drawn(basemap, basemap.window(reached), values, style, words[:1].upper() + words[1:] if title is None else title)


def _basemap(terrain: "Terrain", outlines: list[Any] | None = None) -> Basemap:
    return Basemap(terrain.easting, terrain.northing, terrain.elevation, outlines or [])


def _drawn(basemap: Basemap, window: Window, values: np.ndarray, style: MapStyle, title: str) -> Any:
    from matplotlib import pyplot

    axes, bar = blank_map(basemap, window, title, pyplot.figure)
    draw_values(axes, bar, basemap.extent(window), values[window], style)
    pyplot.sca(axes)
    return axes
