"""Make the picture of docs/guide/structures.md: ``python docs/make_structures_picture.py RESULTS``.

RESULTS is the results folder of a run of sites/dam_demo, which takes some minutes.
"""

import sys
from io import BytesIO
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.image import imread, imsave

from runout.report.figures import tidy
from runout.report.maps import WIDE, draw_map, png
from runout.report.sheets import printed_sheets, reached_window
from runout.report.structures import Loads, forces_over_time
from runout.report.study import read_study
from runout.report.values import STYLES

PICTURE = Path(__file__).parent / "images" / "dam_demo.png"
SHOWN = "Peak flow thickness"  # start of the title of the map
DPI = 130


def draw(results: Path) -> None:
    """Write a map of the flow with the structures, beside the force on them against time."""
    study = read_study(results)
    assert study.loads is not None  # the site has structures
    sheet = next(sheet for sheet in printed_sheets(study) if sheet.title.startswith(SHOWN))
    drawn = draw_map(study.basemap, sheet.values, STYLES[sheet.style], reached_window(study), sheet.title)
    parts = [imread(BytesIO(png(figure, dpi=DPI))) for figure in (drawn, force_figure(study.loads))]
    height = max(len(part) for part in parts)
    parts = [np.pad(part, ((0, height - len(part)), (0, 0), (0, 0)), constant_values=1.0) for part in parts]
    imsave(PICTURE, np.concatenate(parts, axis=1))


def force_figure(loads: Loads) -> Figure:
    """Figure of the force on each structure against time."""
    figure = Figure(figsize=(WIDE, 3.6), layout="constrained")
    axes = figure.subplots()
    for name, force in forces_over_time(loads).items():
        axes.plot(loads.series["record_time"].values, force, linewidth=1.3, label=name)
    axes.set(xlim=(0, None), ylim=(0, None), ylabel="force [kN]")
    axes.legend(frameon=False)
    tidy(axes)
    return figure


if __name__ == "__main__":
    draw(Path(sys.argv[1]))
