"""Make the pictures of the landing page and of README.md: ``python docs/make_pictures.py [jacksboro] [frank_slide]``.

jacksboro takes the results of ``runout run sites/jacksboro``. frank_slide runs a copy of the site with the cells and members of
:data:`FINE`, about four minutes on two cores; its rasters come from ``RUNOUT_DATA`` or from the network.
"""

import re
import shutil
import subprocess
import sys
import tempfile
from io import BytesIO
from pathlib import Path

import numpy as np
from matplotlib.image import imread, imsave

from runout.report.maps import STYLES, draw_map, png
from runout.report.sheets import Sheet, headline_sheets, reached_window
from runout.report.study import Study, read_study

HERE = Path(__file__).parent
SITES = HERE.parent / "sites"
FINE = {"cell_size": 16, "members": 5}  # of frank_slide
SHOWN = {  # starts of the titles of the maps
    "jacksboro": ("Probability", "Peak flow speed, 95th"),
    "frank_slide": ("Probability", "Deposit, mean"),
}


def side_by_side(study: Study, sheets: list[Sheet]) -> np.ndarray:
    """Picture (height, width, 4) of some maps with their titles, one beside the other."""
    window = reached_window(study)
    pictures = []
    for sheet in sheets:
        figure = draw_map(study.basemap, sheet.values, STYLES[sheet.style], window, sheet.title)
        pictures.append(imread(BytesIO(png(figure, dpi=160))))
    return np.concatenate(pictures, axis=1)


def draw(results: Path, name: str) -> None:
    """Write the maps of :data:`SHOWN` of a site's results to docs/images/NAME.png."""
    study, file = read_study(results), HERE / "images" / f"{name}.png"
    sheets = [sheet for start in SHOWN[name] for sheet in headline_sheets(study) if sheet.title.startswith(start)]
    imsave(file, side_by_side(study, sheets))
    print(f"wrote {file}")


def fine_copy(site: Path, folder: Path) -> Path:
    """A copy of a site in a folder, with the numbers of :data:`FINE` in its site.yaml."""
    copy = folder / site.name
    shutil.copytree(site, copy, ignore=shutil.ignore_patterns("results"))
    text = (copy / "site.yaml").read_text(encoding="utf-8")
    for name, value in FINE.items():
        text, found = re.subn(rf"^(\s*{name}: )\S+", rf"\g<1>{value}", text, flags=re.MULTILINE)
        assert found == 1, name
    (copy / "site.yaml").write_text(text, encoding="utf-8")
    return copy


def main(names: list[str]) -> None:
    """Write docs/images/NAME.png for each name; both when none is given."""
    if not names or "jacksboro" in names:
        draw(SITES / "jacksboro" / "results", "jacksboro")
    if not names or "frank_slide" in names:
        with tempfile.TemporaryDirectory() as folder:
            copy = fine_copy(SITES / "frank_slide", Path(folder))
            subprocess.run([sys.executable, "-m", "runout", "run", str(copy)], check=True)
            draw(copy / "results", "frank_slide")


if __name__ == "__main__":
    main(sys.argv[1:])
