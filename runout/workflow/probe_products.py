"""Writes the files of probes and profiles: NetCDF, CSV and figures."""

import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from runout.io import netcdf
from runout.io.atomic import whole_file
from runout.io.probe_files import FOLDER, NAMES, POINTS, SECTIONS, peaks_table, series_table, write_table

if TYPE_CHECKING:
    import xarray as xr

    from runout.config.site import Site

PROBES, PROFILES = FOLDER, "profiles"  # folders in the results
SINGLE = {POINTS: "point", SECTIONS: "cross_section"}
PICTURES = ("png", "svg")
DPI = 150


def write_series(
    datasets: "Mapping[str, xr.Dataset]", folder: Path, stem: str, attributes: Mapping[str, Any], title: str, picture: str = "png"
) -> list[Path]:
    """Write series at probes, tables of series and peaks, and a figure for each probe; returns the paths.

    Files of the same stem that an earlier run wrote, and this one does not, are removed.
    """
    written = []
    for group, dataset in datasets.items():
        name = f"{stem}_{NAMES[group]}"
        described = dataset.assign_attrs({**attributes, "featureType": "timeSeries", "cdm_data_type": "Station", "title": title})
        written += [
            netcdf.write(described, folder / f"{name}.nc"),
            write_table(series_table(dataset), folder / f"{name}_series.csv"),
            write_table(peaks_table(dataset), folder / f"{name}_peaks.csv"),
        ]
    written += write_pictures(datasets, folder, stem, picture)
    remove_others(folder, stem, written)
    return written


def write_pictures(datasets: "Mapping[str, xr.Dataset]", folder: Path, stem: str, picture: str) -> list[Path]:
    """Write a figure for each probe; returns the paths."""
    from runout.report.probe_figures import station_figure

    return [
        write_figure(station_figure(dataset, group, station), folder / f"{stem}_{SINGLE[group]}_{label}.{picture}")
        for group, dataset in datasets.items()
        for station, label in enumerate(file_names(dataset["station_name"].values))
    ]


def write_profiles(
    datasets: "Sequence[xr.Dataset]",
    folder: Path,
    stem: str,
    attributes: Mapping[str, Any],
    title: str,
    picture: str = "png",
    members: "Sequence[xr.Dataset | None] | None" = None,
) -> list[Path]:
    """Write a NetCDF file, a table and a figure of each profile; returns the paths.

    ``members``: profile of the member that the figure of each profile of an ensemble shows.
    """
    from runout.hazard.profiles import profile_table
    from runout.report.probe_figures import profile_figure

    written = []
    labels = file_names([one.attrs["line"] for one in datasets])
    for dataset, label, member in zip(datasets, labels, members or [None] * len(datasets), strict=True):
        line, name = dataset.attrs["line"], f"{stem}_{label}"
        described = dataset.assign_attrs({**attributes, "cdm_data_type": "Trajectory", "title": f"{title}, line {line}"})
        written += [
            netcdf.write(described, folder / f"{name}.nc"),
            write_table(profile_table(dataset), folder / f"{name}.csv"),
            write_figure(profile_figure(dataset, heading(dataset, title), member), folder / f"{name}.{picture}"),
        ]
    remove_others(folder, stem, written)
    return written


def heading(dataset: "xr.Dataset", title: str) -> str:
    """Heading of the figure of a profile."""
    if "percentile" not in dataset.dims:
        return f"Line {dataset.attrs['line']}: {title}"
    levels = dataset["percentile"].values
    band = f"{levels[0]:g} to {levels[-1]:g} % of {dataset.attrs['members']} members at each place (bands)"
    return f"Line {dataset.attrs['line']}: member {dataset.attrs['median_front']}, whose front is the median (lines), and {band}"


def file_names(names: Iterable[str]) -> list[str]:
    """Parts of file names from names of probes; different ones for different names."""
    plain = [re.sub(r"[^A-Za-z0-9-]+", "_", str(name)).strip("_") or "unnamed" for name in names]
    lowered = [name.lower() for name in plain]
    return [name if lowered.count(name.lower()) == 1 else f"{name}_{k}" for k, name in enumerate(plain, 1)]


def write_figure(figure: Any, path: Path) -> Path:
    """Write a figure in the format of the suffix, completely or not at all; returns the path."""
    with whole_file(path) as temporary:
        figure.savefig(temporary, dpi=DPI, metadata={"Date": None} if path.suffix == ".svg" else None)
    return path


def remove_others(folder: Path, stem: str, written: Sequence[Path] = ()) -> None:
    """Remove files of a stem that are not among the written ones."""
    for path in _of_stem(folder, stem):
        if path not in written:
            path.unlink(missing_ok=True)


def _of_stem(folder: Path, stem: str) -> Iterator[Path]:
    present = sorted(folder.iterdir()) if folder.is_dir() else []
    yield from (path for path in present if path.name.startswith(f"{stem}_") and path.suffix in (".nc", ".csv", ".png", ".svg"))


def attributes_of(site: "Site", inputs: Sequence[Path] = ()) -> dict[str, Any]:
    """Global attributes of the files: extent, origin, inputs with checksums, versions, command."""
    origin = site.provenance([*site.inputs(), *inputs], site.settings.ensemble.seed)
    listed = {name: json.dumps(origin[name]) for name in ("inputs", "configuration", "versions")}
    plain = {name: origin[name] for name in ("site", "device", "command", "configuration_sha256", "seed")}
    history = f"{origin['created']} {origin['command']} (runout {origin['runout']})"
    common = netcdf.global_attributes(site.terrain(), "")
    return {**common, "comment": "thicknesses are vertical", "history": history, **listed, **plain}
