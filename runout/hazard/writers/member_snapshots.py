"""``maps/snapshots/``: flow thickness of the member with the median run-out, for a player of time.

Times are those that simulation.snapshots keeps.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from runout.hazard.maps import classes_of
from runout.hazard.writers import Products
from runout.io import netcdf
from runout.io.atomic import write_text
from runout.io.geotiff import write_cog
from runout.io.member_maps import SNAPSHOTS
from runout.quantities import QUANTITIES

FOLDER, MAP = Path("maps") / "snapshots", "flow_thickness"


class Snapshot(NamedTuple):
    """A map of one member at one time."""

    member: int  # the representative one
    # start, end: times from which and until which it shows the flow [s]
    start: float
    end: float
    path: Path  # below the results, without suffix


def snapshots(products: Products) -> Iterator[Snapshot]:
    """Snapshots in the order of time; none where the members keep none."""
    times = products.snapshots
    if not times:
        return
    member, width = products.representative, len(str(len(times)))
    last = times[-1] + (times[-1] - times[-2] if len(times) > 1 else 1.0)
    for number, (start, end) in enumerate(zip(times, [*times[1:], last], strict=True)):
        yield Snapshot(member, start, end, FOLDER / f"{MAP}_{number:0{width}d}_at_{start:.6g}s")


def write(products: Products) -> list[Path]:
    """Paths of a raster and a style of each snapshot; its classes are those of the largest thickness of all members."""
    paths, style, dataset = [], "", None
    for one in snapshots(products):
        if dataset is None:
            dataset = netcdf.read(products.ensemble.files[one.member], SNAPSHOTS)
            style = classes_of(products.hazard, QUANTITIES["thickness"].peak).qml()
        target = products.results / one.path
        paths.append(write_cog(dataset, MAP, target.with_name(f"{target.name}.tif"), time=one.start))
        paths.append(write_text(style, target.with_name(f"{target.name}.qml")))
    return paths


def earlier(results: Path) -> set[Path]:
    """Snapshots of earlier runs, with what a GIS noted of them."""
    return {path for kind in ("tif", "qml", "tif.aux.xml") for path in (results / FOLDER).glob(f"{MAP}_*s.{kind}")}
