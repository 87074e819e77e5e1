"""Runs the ensemble of a ``hazard.nc`` again from the settings and checksums that the file holds, and compares all maps."""

import json
import platform
from collections.abc import Iterator, Mapping
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from runout import __version__, log
from runout.config.document import read_text
from runout.config.read import FILE_NAME, checked
from runout.config.site import Site
from runout.config.site_files import OF_MEMBERS, OF_PRODUCTS
from runout.errors import ConfigError, ExitCode, InputError, StorageError
from runout.io import netcdf, source_code
from runout.io.boundary import require_regular
from runout.io.provenance import input_record, installed_versions
from runout.workflow.hazard_map import run_study
from runout.workflow.study import Study

if TYPE_CHECKING:
    import xarray as xr

PRODUCT = "hazard.nc"
NEEDED = ("site_settings", "inputs", "versions", "source_code_sha256")  # attributes
STAGES = ("ensemble", "hazard")


@dataclass(frozen=True)
class Origin:
    """What a product says of its origin."""

    product: Path  # the ``hazard.nc``
    folder: Path  # folder of the site, where the inputs lie
    attributes: Mapping[str, Any]  # global attributes

    @classmethod
    def read(cls, path: Path, folder: Path | None = None) -> "Origin":
        """The origin of a ``hazard.nc`` or of the one in a results folder; the site is the folder above, unless it is stated.

        Raises InputError if there is no such file. Raises StorageError if it cannot be read, or does not hold its settings.
        """
        product = path / PRODUCT if path.is_dir() else path
        require_regular(product, InputError)
        attributes = netcdf.read_attributes(product)
        lacking = [name for name in NEEDED if name not in attributes]
        if lacking:
            raise StorageError(f"{product}: has no attribute {', '.join(lacking)}; make it with `runout run` of this version first")
        return cls(product, folder or product.absolute().parent.parent, attributes)

    def site(self) -> Site:
        """The site of the settings, whose input files are those that the product was made of.

        Raises InputError if an input is missing, or its content is another; the message names all of them.
        """
        document = read_text(str(self.attributes["site_settings"]), self.product.name)
        where = f"the inputs are looked for in {self.folder}; --site names the folder of the site"
        try:
            settings = checked(document, self.folder)
        except ConfigError as error:
            raise InputError(f"{error}\n{where}") from error
        site = Site(self.folder, self.folder / FILE_NAME, settings.name, settings)
        records = [input_record(path, self.folder) for path in site.files.paths(*OF_MEMBERS, *OF_PRODUCTS)]
        if changed := list(_changed_inputs(json.loads(self.attributes["inputs"]), records)):
            raise InputError("\n".join([*changed, f"the maps cannot be reproduced; restore these inputs; {where}"]))
        return site

    def differences(self, site: Site) -> list[str]:
        """In what version, libraries, source code and device of this machine differ from those of the product."""
        versions = {"python": platform.python_version()} | installed_versions()
        pairs = {name: (made, versions.get(name, "none")) for name, made in json.loads(self.attributes["versions"]).items()}
        pairs["runout"] = str(self.attributes["source"]).split(",")[0].removeprefix("runout "), __version__
        pairs["source code of runout"] = str(self.attributes["source_code_sha256"]), source_code.checksums().products
        pairs["device"] = str(self.attributes["device"]), site.settings.simulation.device
        return [f"{name}: {made} made the maps, {now} is used now" for name, (made, now) in pairs.items() if made != now]


def _changed_inputs(made: list[dict[str, Any]], now: list[dict[str, Any]]) -> Iterator[str]:
    """A line for each input that is missing, new, or has another content."""
    before, present = ({record["name"]: record["sha256"] for record in records} for records in (made, now))
    for name in {**before, **present}:
        if name not in present:
            yield f"{name}: is missing (SHA-256 {before[name]})"
        elif name not in before:
            yield f"{name}: is new (SHA-256 {present[name]})"
        elif before[name] != present[name]:
            yield f"{name}: has changed (SHA-256 {before[name]} made the maps, it is {present[name]} now)"


def map_differences(made: "xr.Dataset", now: "xr.Dataset") -> Iterator[str]:
    """A line for each variable whose bits differ in two datasets, with the number of values and the largest difference."""
    for name in dict.fromkeys([*made.variables, *now.variables]):
        if name not in made.variables or name not in now.variables:
            yield f"{name}: only one of the two has it"
            continue
        one, other = made[name].values, now[name].values
        if one.shape != other.shape or one.dtype != other.dtype:
            yield f"{name}: {one.dtype} {one.shape} and {other.dtype} {other.shape}"
        elif one.tobytes() != other.tobytes():
            yield f"{name}: {_difference(one, other)}"


def _difference(one: np.ndarray, other: np.ndarray) -> str:
    """How many values of two arrays of a shape differ, and by how much at most where both are numbers."""
    numeric = np.issubdtype(one.dtype, np.number)
    count = int((~((one == other) | ((one != one) & (other != other)))).sum())
    gap = np.abs(one.astype(float) - other.astype(float)) if numeric else np.empty(0)
    finite = gap[np.isfinite(gap)]
    return f"{count} of {one.size} values differ" + (f", by {finite.max():.3g} at most" if finite.size else "")


def reproduce(
    path: Path,
    out: Path | None = None,
    folder: Path | None = None,
    *,
    workers: int | None = None,
    threads: int | None = None,
    device: str | None = None,
) -> int:
    """Run the ensemble of a product again and compare its maps with it, bit by bit; prints what differs.

    Parameters
    ----------
    path : Path
        A ``hazard.nc`` or its results folder.
    out : Path, optional
        Folder of the new results; a temporary one if None.
    folder : Path, optional
        Folder of the site with its inputs; the folder above the results if None.
    workers, threads, device
        As of :func:`runout.workflow.hazard_map.run`.

    Returns
    -------
    int
        Exit code: 0 if all maps are equal to the bit, else 1.

    Raises
    ------
    InputError, StorageError
        See :meth:`Origin.site` and :meth:`Origin.read`; also if ``out`` holds members already.
    """
    origin = Origin.read(path, folder)
    if out is not None and any((Path(out) / "members").glob("*")):
        raise InputError(f"--out {out}: holds members, which would not be run again; name another folder")
    site, console = origin.site(), log.output()
    site = site if device is None else site.on_device(device)
    for line in origin.differences(site):
        console.print(f"differs   {line}", markup=False)
    made = netcdf.read(origin.product)
    with nullcontext(str(out)) if out else TemporaryDirectory(prefix="runout_") as place:
        study = Study.of(site, Path(place))
        run_study(replace(study, workers=workers, threads=threads or site.settings.simulation.threads), STAGES)
        lines = list(map_differences(made, netcdf.read(study.results / PRODUCT)))
    for line in lines:
        console.print(f"differs   {line}", markup=False)
    equal = f"all {len(made.variables)} variables are equal to the bit"
    console.print(f"{origin.product}: {f'{len(lines)} variables differ' if lines else equal}", markup=False)
    return ExitCode.FAILURE if lines else ExitCode.OK
