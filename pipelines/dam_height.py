"""Overtopping against the height of a dam: copies of a site -> ensembles -> table and figure.

    python pipelines/dam_height.py sites/dam_demo study 3 4 5 6 8

Heights [m] replace that of the first structure with `protects`. The members have the same samples at each height.
"""

import shutil
import sys
from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure
from ruamel.yaml import YAML

from runout.io import netcdf
from runout.workflow import hazard_map


def with_height(site_folder: Path, folder: Path, height: float) -> Path:
    """A copy of a site whose dam has a height [m]."""
    shutil.copytree(site_folder, folder, ignore=shutil.ignore_patterns("results"), dirs_exist_ok=True)
    yaml = YAML()
    settings = yaml.load(folder / "site.yaml")
    next(structure for structure in settings["structures"] if "protects" in structure)["height"] = height
    yaml.dump(settings, folder / "site.yaml")
    return folder


def overtopping(results: Path) -> dict[str, float]:
    """Probability of overtopping, and volumes behind the dam [m3] by percentile."""
    found = netcdf.read(results / "structures.nc").isel(area=0)
    volumes = found["overtopping_volume_at_percentile"]
    columns = {f"volume_p{p:g}_m3": float(v) for p, v in zip(volumes["percentile"].values, volumes.values, strict=True)}
    return {"probability": float(found["overtopping_probability"]), **columns}


def main(site_folder: Path, out: Path, heights: list[float]) -> pd.DataFrame:
    """Table of overtopping by height of the dam, after writing it to ``overtopping.csv`` and drawing ``overtopping.png``."""
    rows = {}
    for height in heights:
        copy = with_height(site_folder, out / f"height_{height:g}", height)
        hazard_map.run(copy)
        rows[height] = overtopping(copy / "results")
    table = pd.DataFrame.from_dict(rows, orient="index").rename_axis("height_m")
    table.to_csv(out / "overtopping.csv")
    figure = Figure(figsize=(6.0, 3.5), layout="constrained")
    axes = figure.subplots()
    table.drop(columns="probability").plot(ax=axes, marker="o", xlabel="height of the dam [m]", ylabel="volume behind it [m³]")
    figure.savefig(out / "overtopping.png", dpi=150)
    return table


if __name__ == "__main__":
    print(main(Path(sys.argv[1]), Path(sys.argv[2]), [float(height) for height in sys.argv[3:]]))
