"""Make the picture of the landing page and of README.md: ``python docs/make_pictures.py [RESULTS]``.

Without results of an earlier run, it runs a copy of frank_slide with the cells and members of :data:`FINE`, which takes
some minutes. The rasters come from ``RUNOUT_DATA`` or from the network.
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

from runout.report.maps import draw_map, png
from runout.report.sheets import Sheet, printed_sheets, reached_window
from runout.report.study import Study, read_study
from runout.report.values import STYLES

HERE = Path(__file__).parent
SITE = HERE.parent / "sites" / "frank_slide"
PICTURE = HERE / "images" / "frank_slide.png"
FINE = {"cell_size": 16, "members": 5}  # in place of the numbers in site.yaml
SHOWN = ("Probability", "Deposit, mean")  # starts of the titles of the maps


def side_by_side(study: Study, sheets: list[Sheet]) -> np.ndarray:
    """Picture (height, width, 4) of some maps with their titles, one beside the other."""
    window = reached_window(study)
    pictures = []
    for sheet in sheets:
        figure = draw_map(study.basemap, sheet.values, STYLES[sheet.style], window, sheet.title)
        pictures.append(imread(BytesIO(png(figure, dpi=160))))
    return np.concatenate(pictures, axis=1)


def draw(results: Path) -> None:
    """Write the maps of :data:`SHOWN` of a site's results to :data:`PICTURE`."""
    study = read_study(results)
    sheets = [sheet for start in SHOWN for sheet in printed_sheets(study) if sheet.title.startswith(start)]
    imsave(PICTURE, side_by_side(study, sheets))
    print(f"wrote {PICTURE}")


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


def main() -> None:
    """Draw the results that are named, or those of a run."""
    if len(sys.argv) > 1:
        draw(Path(sys.argv[1]))
        return
    with tempfile.TemporaryDirectory() as folder:
        copy = fine_copy(SITE, Path(folder))
        subprocess.run([sys.executable, "-m", "runout", "run", str(copy)], check=True)
        draw(copy / "results")


if __name__ == "__main__":
    main()
