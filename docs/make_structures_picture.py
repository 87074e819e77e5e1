"""Make the picture of docs/guide/structures.md: ``python docs/make_structures_picture.py RESULTS``.

RESULTS is the results folder of a run of sites/dam_demo, which takes some minutes.
"""

import sys
from io import BytesIO
from pathlib import Path

import numpy as np
from matplotlib.image import imread, imsave

from runout.report.maps import draw_map
from runout.report.picture import png
from runout.report.sheets import headline_sheets, reached_window
from runout.report.structures import force_figure
from runout.report.study import read_study
from runout.report.values import STYLES

PICTURE = Path(__file__).parent / "images" / "dam_demo.png"
SHOWN = "Peak flow thickness, 95th"  # start of the title of the map
DPI = 130


def draw(results: Path) -> None:
    """Write a map of the flow with the structures, beside the force on them against time."""
    study = read_study(results)
    assert study.loads is not None  # the site has structures
    sheet = next(sheet for sheet in headline_sheets(study) if sheet.title.startswith(SHOWN))
    drawn = draw_map(study.basemap, sheet.values, STYLES[sheet.style], reached_window(study), sheet.title)
    parts = [imread(BytesIO(png(figure, dpi=DPI))) for figure in (drawn, force_figure(study.loads))]
    height = max(len(part) for part in parts)
    parts = [np.pad(part, ((0, height - len(part)), (0, 0), (0, 0)), constant_values=1.0) for part in parts]
    imsave(PICTURE, np.concatenate(parts, axis=1))


if __name__ == "__main__":
    draw(Path(sys.argv[1]))
