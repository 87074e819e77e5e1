"""Make the picture of docs/guide/where_it_fails: ``python docs/make_where_it_fails.py``.

Left the factor of safety of cascades_2021 with the releases that are proposed for wet soil, right the baseline of its mapped
landslide. The rasters come from ``RUNOUT_DATA`` or from the network.
"""

from io import BytesIO
from pathlib import Path

import numpy as np
from matplotlib.image import imread, imsave

from runout import read_site
from runout.report.maps import draw_map, png
from runout.slopes.choices import MassWasting, Strength
from runout.slopes.drainage import drainage
from runout.slopes.infinite_slope import resolved, stability
from runout.slopes.mass_wasting import mass_wasting
from runout.slopes.path_features import features, flow_path
from runout.slopes.screening import LEAST, picture
from runout.slopes.suggestion import SHEETS, basemap, suggest

HERE = Path(__file__).parent
SITE = HERE.parent / "sites" / "cascades_2021"
PICTURE = HERE / "images" / "where_it_fails.png"
WET = resolved(Strength(saturation=(0.5, 1.0)))
DPI = 160


def main() -> None:
    """Write :data:`PICTURE`."""
    data = read_site(SITE).data()
    drained = drainage(data.terrain)
    stable = stability(drained, WET)
    patches = suggest(drained, stable, WET).patches
    base, _ = basemap(data.terrain, patches)
    _, style, _ = SHEETS["factor_of_safety"]
    left = png(draw_map(base, stable.factor, style, title="Factor of safety, proposed releases"), DPI)
    found = mass_wasting(data.terrain, data.releases, MassWasting())
    around = drainage(found.terrain)
    way = flow_path(around, found.release, found.peak, LEAST)
    right = picture(found, around, way, features(around, way, found.peak, []), DPI)
    panels = [imread(BytesIO(panel)) for panel in (left, right)]
    height = min(panel.shape[0] for panel in panels)
    imsave(PICTURE, np.concatenate([panel[:height] for panel in panels], axis=1))
    print(f"wrote {PICTURE}")


if __name__ == "__main__":
    main()
