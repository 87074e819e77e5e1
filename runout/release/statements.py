"""What check, the log and the report say of releases: volume, area, thickness, edge, and what starts together."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from runout.model.release import Edge, Release

TOGETHER = "start together at time zero, in every member"
THINS = ": it thins out to its outline and keeps its volume, so that its middle is thicker than the mean"
ALONE = "where each may fail alone, make a site of each, with its own"


def statement(release: Release) -> str:
    """Volume, area, placement, edge and thickness of a release in one sentence."""
    size = f"{release.volume:.4g} m3 on {release.area:.4g} m2"
    thickness = f"{release.mean_thickness:.3g} m thick on average, {release.thickness.max():.3g} m at most"
    return f"release {release.name}: {size}, {thickness}, {shape(release)}"


def shape(release: Release) -> str:
    """Placement and edge of a release in words."""
    edge = f", {release.edge} edge" if release.outline is not None else ""
    return f"{str(release.placement).replace('_', ' ')}{edge}{THINS if release.edge is Edge.TAPERED else ''}"


def record(release: Release) -> dict[str, Any]:
    """What ``run.json`` keeps of a release for the report, in SI units."""
    sizes = {"volume": release.volume, "area": release.area, "mean_thickness": release.mean_thickness}
    return {"name": release.name, **sizes, "largest_thickness": float(release.thickness.max()), "shape": shape(release)}


def start_sentences(releases: Sequence[Release]) -> Iterator[str]:
    """Sentences on parts of a release that do not touch, and on several releases: they start at the same time."""
    for release in releases:
        count = separate_parts(release)
        if count > 1:
            kind = "polygons" if release.outline is not None else "patches"
            own = "polygon" if release.outline is not None else "raster"
            yield f"release {release.name}: its {count} separate {kind} {TOGETHER}; {ALONE} {own}"
    if len(releases) > 1:
        names = ", ".join(release.name for release in releases)
        yield f"the {len(releases)} releases ({names}) {TOGETHER}; {ALONE} release"


def separate_parts(release: Release) -> int:
    """Number of parts of a release that do not touch."""
    if release.outline is not None:
        return len(getattr(release.outline, "geoms", [release.outline]))
    from scipy import ndimage

    return int(ndimage.label(release.thickness > 0, structure=np.ones((3, 3)))[1])
