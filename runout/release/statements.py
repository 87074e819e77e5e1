"""What check, the log and the report say of releases: volume, area, thickness, edge, and what starts together."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from runout.model.release import Edge, Placement, Release
from runout.model.release_start import StartVelocity

TOGETHER = "start together at time zero, in every member"
THINS = ": it thins out to its outline and keeps its volume, so that its middle is thicker than the mean"
WAITS = {
    Placement.EXCAVATED: "until then it is ground, over which other flows go",
    Placement.ON_SURFACE: "it is not there before, and is then put on what lies there",
}
ALONE = "where each may fail alone, make a site of each, with its own"
BY_SCENARIO = "where each may fail alone, name it in the releases of a scenario (ensemble.scenarios)"


def statement(release: Release) -> str:
    """Volume, area, placement, edge and thickness of a release in one sentence."""
    size = f"{release.volume:.4g} m3 on {release.area:.4g} m2"
    thickness = f"{release.mean_thickness:.3g} m thick on average, {release.thickness.max():.3g} m at most"
    return f"release {release.name}: {size}, {thickness}, {shape(release)}"


def shape(release: Release) -> str:
    """Placement and edge of a release in words."""
    edge = f", {release.edge} edge" if release.outline is not None else ""
    return f"{str(release.placement).replace('_', ' ')}{edge}{THINS if release.edge is Edge.TAPERED else ''}{_start(release)}"


def _start(release: Release) -> str:
    """When and how fast a release starts, as the end of a sentence; empty for one that starts at once, at rest."""
    when = f"starts {release.starts_when}" if release.starts_when else ""
    when = f"starts at {release.start_time:g} s" if release.start_time else when
    parts = [when, _velocity(release)]
    return "".join(f", {part}" for part in parts if part)


def _velocity(release: Release) -> str:
    velocity = release.velocity
    if isinstance(velocity, StartVelocity):
        where = "down the slope" if velocity.azimuth_deg is None else f"towards {velocity.azimuth_deg:g} deg from north"
        return f"with {velocity.speed:g} m/s {where}"
    return "with {:g}, {:g}, {:g} m/s east, north and up".format(*velocity) if isinstance(velocity, tuple) else ""


def record(release: Release) -> dict[str, Any]:
    """What ``run.json`` keeps of a release for the report, in SI units."""
    sizes = {"volume": release.volume, "area": release.area, "mean_thickness": release.mean_thickness}
    return {"name": release.name, **sizes, "largest_thickness": float(release.thickness.max()), "shape": shape(release)}


def start_sentences(releases: Sequence[Release], by_scenario: bool = False) -> Iterator[str]:
    """Sentences on parts of a release that do not touch, and on several releases: which start at the same time, and which later.

    ``by_scenario``: the scenario of a member decides which of the releases fail.
    """
    for release in releases:
        count = separate_parts(release)
        if count > 1:
            kind = "polygons" if release.outline is not None else "patches"
            own = "polygon" if release.outline is not None else "raster"
            yield f"release {release.name}: its {count} separate {kind} {TOGETHER}; {ALONE} {own}"
    at_once = [release.name for release in releases if not release.waits]
    if len(at_once) > 1:
        names = f"the {len(at_once)} releases ({', '.join(at_once)})"
        yield f"{names} fail as the scenario of a member says" if by_scenario else f"{names} {TOGETHER}; {BY_SCENARIO}"
    for release in releases:
        if release.waits:
            yield f"release {release.name}{_start(release)[1:]}; {WAITS[release.placement]}"


def separate_parts(release: Release) -> int:
    """Number of parts of a release that do not touch."""
    if release.outline is not None:
        return len(getattr(release.outline, "geoms", [release.outline]))
    from scipy import ndimage

    return int(ndimage.label(release.thickness > 0, structure=np.ones((3, 3)))[1])
