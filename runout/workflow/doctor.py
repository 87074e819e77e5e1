"""Examines installed libraries, devices and caches; reports problems and remedies."""

import importlib
import os
import platform
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from runout import __version__, log
from runout.errors import ExitCode, RenderError
from runout.processes import caches
from runout.processes.lifetime import import_path, python_command

LIBRARIES = ("numpy", "numba", "warp-lang", "rasterio", "pyproj", "pyogrio", "netCDF4", "xarray", "matplotlib")
IMPORTED = ("numpy", "numba", "rasterio", "pyproj", "pyogrio", "netCDF4", "xarray", "matplotlib")
ASK_WARP = "import warp; [print(f'device: {d.alias} ({d.name})') for d in warp.get_cuda_devices()]"
FOREIGN_DATA = {  # set by QGIS, conda or OSGeo4W for their own build
    "PROJ_DATA": "the PROJ database of another program",
    "PROJ_LIB": "the PROJ database of another program",
    "GDAL_DATA": "the GDAL files of another program",
    "GDAL_DRIVER_PATH": "GDAL plugins of another program",
}


@dataclass(frozen=True)
class Finding:
    """One line of the examination; ``fix`` is empty if there is no problem."""

    topic: str
    text: str
    fix: str = ""


def findings() -> list[Finding]:
    """All lines of the examination, in their order."""
    return [*_versions(), *_imports(), *_devices(), *_caches(), *_foreign_data(), *_coordinates()]


def examine() -> int:
    """Print the examination; exit code 1 if there are problems."""
    console, topic, escape = log.output(), "", log.escaped
    found = findings()
    for finding in found:
        if finding.topic != topic:
            topic = finding.topic
            console.print(f"[bold]{topic}[/]")
        mark = "[red]wrong[/]" if finding.fix else "[green]ok[/]   "
        console.print(f"  {mark} {escape(finding.text)}" + (f"\n        fix: {escape(finding.fix)}" if finding.fix else ""))
    wrong = sum(bool(finding.fix) for finding in found)
    console.print(f"[bold]{'nothing is' if wrong == 0 else wrong} wrong[/]" + ("" if wrong <= 1 else " (each with its fix above)"))
    return ExitCode.FAILURE if wrong else ExitCode.OK


def _versions() -> Iterator[Finding]:
    yield Finding("versions", f"runout {__version__}, Python {platform.python_version()} on {platform.platform()}")
    for name in LIBRARIES:
        try:
            yield Finding("versions", f"{name} {metadata.version(name)}")
        except metadata.PackageNotFoundError:
            yield Finding("versions", f"{name} is not installed", f"{sys.executable} -m pip install {name}")


def _imports() -> Iterator[Finding]:
    broken = []
    for name in IMPORTED:
        try:
            importlib.import_module(name)
        except (ImportError, OSError, AttributeError, RuntimeError) as error:
            fix = f"{sys.executable} -m pip install --force-reinstall {name}"
            broken.append(Finding("imports", f"{name} cannot be imported: {error}", fix))
    yield from broken or [Finding("imports", "all libraries can be imported")]


def _devices() -> Iterator[Finding]:
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    threads = os.environ.get("NUMBA_NUM_THREADS") or os.environ.get("OMP_NUM_THREADS")
    yield Finding("devices", f"cpu: {usable} cores" + (f", {threads} threads asked for by the environment" if threads else ""))
    yield Finding("devices", _memory())
    yield from _graphics()
    yield Finding("devices", f"3D pictures: {_pictures()}")


def _memory() -> str:
    import psutil

    memory = psutil.virtual_memory()
    return f"memory: {memory.available / 1e9:.1f} GB free of {memory.total / 1e9:.1f} GB"


def _graphics() -> Iterator[Finding]:
    """Devices of warp, found by another process, since a broken driver may end it."""
    environment = {**os.environ, "PYTHONPATH": import_path()}
    command = python_command(ASK_WARP)
    asked = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120, check=False)
    if asked.returncode:
        reason = (asked.stderr.strip() or f"it ended with code {asked.returncode}").splitlines()[-1]
        yield Finding("devices", f"gpu: warp cannot start ({reason}); the CPU backend does not need it")
        return
    devices = [line.removeprefix("device: ") for line in asked.stdout.splitlines() if line.startswith("device: ")]
    yield Finding("devices", "gpu: " + (", ".join(devices) or "none; the CPU backend does not need one"))


def _pictures() -> str:
    """What draws pictures in three dimensions, or why nothing does; only view, animate and stills need it."""
    from runout.view.process import drawn_by

    try:
        return drawn_by()
    except RenderError as error:
        return f"none; {error}"


def _caches() -> Iterator[Finding]:
    for cache in caches.all_caches():
        where, fault, reason = f"{cache.name}: {cache.folder}", cache.fault(), caches.try_to_write(cache.folder)
        if fault:
            remedy = f"set {cache.variable} to a folder of your own"
            yield Finding("caches", f"{where} {fault}; others could place code there", remedy)
        elif reason:
            yield Finding("caches", f"{where} cannot be written ({reason})", f"set {cache.variable} to a folder that you may write")
        else:
            yield Finding("caches", where)


def _foreign_data() -> Iterator[Finding]:
    for variable, what in FOREIGN_DATA.items():
        value = os.environ.get(variable)
        if value:
            missing = "" if Path(value).exists() else " and does not exist"
            fix = f"unset {variable}, here or in the program that started this shell"
            yield Finding("environment", f"{variable}={value} may be {what}{missing}", fix)


def _coordinates() -> Iterator[Finding]:
    """Whether rasterio finds coordinate systems; it does not with the PROJ database of another version."""
    try:
        from rasterio.crs import CRS
        from rasterio.errors import CRSError
    except ImportError:
        return  # reported with the imports
    try:
        CRS.from_epsg(32616).to_wkt()
    except CRSError as error:
        yield Finding("environment", f"rasterio finds no coordinate system: {error}", "unset PROJ_DATA and PROJ_LIB")
    else:
        yield Finding("environment", "rasterio finds its coordinate systems")
