"""Makes the pictures of the documentation from the results of sites/jacksboro.

Run `runout run sites/jacksboro` first, then `python docs/make_pictures.py`.
"""

import sys
from io import BytesIO
from pathlib import Path

import numpy as np
from matplotlib.image import imread, imsave

from runout.report.maps import STYLES, draw_map, png
from runout.report.sheets import Sheet, headline_sheets, reached_window
from runout.report.study import Study, read_study

HERE = Path(__file__).parent
RESULTS = HERE.parent / "sites" / "jacksboro" / "results"
SHOWN = ("Probability", "Peak flow speed, 95th")


def side_by_side(study: Study, sheets: list[Sheet]) -> np.ndarray:
    """Picture (height, width, 4) of some maps with their titles, one beside the other."""
    window = reached_window(study)
    pictures = []
    for sheet in sheets:
        figure = draw_map(study.basemap, sheet.values, STYLES[sheet.style], window, sheet.title)
        pictures.append(imread(BytesIO(png(figure, dpi=160))))
    return np.concatenate(pictures, axis=1)


def main(results: Path) -> None:
    """Write docs/images/jacksboro.png."""
    study = read_study(results)
    sheets = [sheet for start in SHOWN for sheet in headline_sheets(study) if sheet.title.startswith(start)]
    imsave(HERE / "images" / "jacksboro.png", side_by_side(study, sheets))


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else RESULTS)
