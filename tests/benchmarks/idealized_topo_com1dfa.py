"""Numbers of com1DFA (AvaFrame 2.1) on ISeeSnow's IdealizedTopo, with and without some of its terms, for the case idealized_topo.

    python3 -m venv ENV && ENV/bin/pip install avaframe==2.1
    ENV/bin/python -m tests.benchmarks.idealized_topo_com1dfa run --out DIR
    python -m tests.benchmarks.idealized_topo_com1dfa record --out DIR

``run`` needs AvaFrame in an environment of its own; DIR then holds the maps of each run. ``record`` needs runout. It computes the
numbers and writes `tests/benchmarks/records/idealized_topo_com1dfa.json`. Both read RUNOUT_DATA/iseesnow/IdealizedTopo.

Configuration: AvaFrame's defaults with cells of 5 m, Voellmy friction with the numbers of the case, type null, no dam. com1DFA
has no earth pressure coefficients: the script multiplies the pressure force along the velocity of a particle and across it.
"""

import csv
import json
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from tests.benchmarks.avakot_com1dfa import AVAFRAME, CELLS, PEAKS, STANDARD, main, main_configuration, only

SITE = "iseesnow/IdealizedTopo"
STRETCHED = 60.0  # time [s] of the cross-sections
PLUGGED = 1.0  # speed [m/s] towards the east above which a particle is part of a plug
LOOKS = (20.0, 40.0, STRETCHED)
MAPS = ("FT", "FV")  # AvaFrame's names of flow thickness [m] and speed [m/s] at a time
END = 100.0  # time [s] at which runs end unless they stop before: their fronts have stopped
ENDS = {"tEnd": f"{END:g}"}


@dataclass(frozen=True)
class Variant:
    """Settings of AvaFrame that differ from the standard run, factors of the pressure force along the velocity and across it.

    ``plug``: every cross-section of the flow moves with its mean velocity.
    """

    settings: dict[str, str] = field(default_factory=dict)
    along: float = 1.0
    across: float = 1.0
    plug: bool = False


VARIANTS = {
    STANDARD: Variant(),
    "plug": Variant(plug=True),
    "no pressure": Variant({"sphOption": "0", **ENDS}),
    "pressure x 0.6": Variant(ENDS, along=0.6, across=0.6),
    "no artificial viscosity": Variant({"viscOption": "0", **ENDS}),
    "pressure across x 2": Variant(ENDS, across=2.0),
    "pressure x 0.8": Variant(ENDS, along=0.8, across=0.8),
    "no curvature in friction": Variant({"curvAccInFriction": "0", **ENDS}),
}
ANGLES = (5.0, 30.0)  # internal friction [deg] of runs of runout with friction of the whole column


def folder_of(out: Path, variant: str) -> Path:
    """Folder of a run."""
    return out / variant.replace(" ", "_")


def run_all(out: Path) -> None:
    """Run com1DFA with each variant that DIR does not hold; one process, one after the other."""
    installed = version("avaframe")
    if installed != AVAFRAME:
        sys.exit(f"avaframe is {installed}; the record is of {AVAFRAME}: pip install avaframe=={AVAFRAME}")
    inputs = Path(os.environ.get("RUNOUT_DATA", ".")) / SITE
    if not inputs.is_dir():
        sys.exit(f"{inputs} is not there; set RUNOUT_DATA to the folder that holds {SITE}")
    for name, variant in VARIANTS.items():
        started = time.perf_counter()
        if not folder_of(out, name).is_dir():
            run(inputs, variant, folder_of(out, name))
        print(f"{name}: {time.perf_counter() - started:.0f} s", flush=True)


def run(inputs: Path, variant: Variant, out: Path) -> None:
    """Run com1DFA in a temporary project; its peaks, and its maps at :data:`LOOKS`, go to ``out``."""
    from avaframe.com1DFA import com1DFA

    with tempfile.TemporaryDirectory() as folder:
        project = project_of(inputs, Path(folder) / "topo")
        with patched(com1DFA.DFAfunC, variant), open(os.devnull, "w") as nowhere, redirect_stdout(nowhere):  # prints each step
            com1DFA.com1DFAMain(main_configuration(project), cfgInfo=configuration(inputs, variant))
        peaks = project / "Outputs" / "com1DFA" / "peakFiles"
        out.mkdir(parents=True)
        for name in PEAKS:
            shutil.copy(only(peaks, f"*_{name}.*"), out / f"{name}.tif")
        for name in MAPS:
            for seconds in LOOKS:
                shutil.copy(at_time(peaks / "timeSteps", name, seconds), out / f"{name}_{seconds:g}.tif")


def at_time(folder: Path, name: str, seconds: float) -> Path:
    """The map of a name that is nearest to a time."""
    return min(folder.glob(f"*_{name}_t*.*"), key=lambda path: abs(float(path.stem.rpartition("_t")[2]) - seconds))


def project_of(inputs: Path, project: Path) -> Path:
    """A new project of AvaFrame with the terrain and the polygon of the release, whose thickness is normal to the slope."""
    (project / "Inputs" / "REL").mkdir(parents=True)
    shutil.copy(only(inputs, "DEM_*.tif"), project / "Inputs")
    for path in inputs.glob("release1HS.*"):
        shutil.copy(path, project / "Inputs" / "REL")
    return project


def configuration(inputs: Path, variant: Variant) -> Any:
    """com1DFA's default configuration with the friction of the case and the settings of a variant."""
    from avaframe.com1DFA import com1DFA
    from avaframe.in3Utils import cfgUtils

    with open(only(inputs, "simulationParameterValues_*.csv"), encoding="utf-8") as file:
        row = next(csv.DictReader(file))
    chosen = cfgUtils.getModuleConfig(com1DFA, onlyDefault=True, toPrint=False)
    chosen["GENERAL"].update(simTypeList="null", dam="False", frictModel="Voellmy", meshCellSize=f"{CELLS:g}", rho="200")
    chosen["GENERAL"].update(muvoellmy=row["mu"], xsivoellmy=row["xi"], resType="|".join(("ppr", *PEAKS, *MAPS)))
    chosen["GENERAL"].update(tSteps="|".join(f"{seconds:g}" for seconds in LOOKS), **variant.settings)
    return chosen


@contextmanager
def patched(module: Any, variant: Variant) -> Iterator[None]:
    """com1DFA's functions of a time step with what a variant changes; children of the process inherit them."""
    force, move = module.computeForceSPHC, module.updatePositionC
    module.computeForceSPHC = scaled(force, variant)
    module.updatePositionC = plugged(move) if variant.plug else move
    yield
    module.computeForceSPHC, module.updatePositionC = force, move


def scaled(original: Any, variant: Variant) -> Any:
    """com1DFA's pressure force with the factors of a variant along the velocity of each particle and across it."""

    def forces(cfg: Any, particles: Any, force: Any, *rest: Any, **choices: Any) -> Any:
        particles, force = original(cfg, particles, force, *rest, **choices)
        names = [f"forceSPH{axis}" for axis in "XYZ"]
        pressure = np.array([force[name] for name in names])
        velocity = np.array([particles[f"u{axis}"] for axis in "xyz"])
        square = np.maximum((velocity**2).sum(axis=0), 1e-6)
        along = velocity * (pressure * velocity).sum(axis=0) / square
        force.update(zip(names, variant.across * pressure + (variant.along - variant.across) * along, strict=True))
        return particles, force

    return forces


def plugged(original: Any) -> Any:
    """com1DFA's motion; then each section of :data:`CELLS` has its mean velocity towards the east."""

    def moves(*arguments: Any, **choices: Any) -> Any:
        particles = original(*arguments, **choices)
        section, mass, east = (particles["x"] / CELLS).astype(int), particles["m"], particles["ux"]
        mean = np.bincount(section, mass * east) / np.maximum(np.bincount(section, mass), 1e-9)
        moving = east > PLUGGED
        factor = np.where(moving, mean[section] / np.where(moving, east, 1.0), 1.0)  # keeps velocities along the ground
        particles.update({f"u{axis}": particles[f"u{axis}"] * factor for axis in "xyz"})
        return particles

    return moves


def read(inputs: Any, path: Path) -> np.ndarray:
    """A map of com1DFA on the cells of the terrain, 0 where nothing flowed."""
    from runout.studies.validation_cases.case import on_cells

    return np.nan_to_num(on_cells(path, inputs.terrain)).clip(0.0)


def numbers(inputs: Any, thickness: np.ndarray, speed: np.ndarray, frames: Sequence[np.ndarray]) -> dict[str, Any]:
    """Numbers of peaks and of the thicknesses [m] at :data:`LOOKS`, all normal to the slope."""
    from docs.pages.iseesnow_terms import means_along, stretch
    from runout.studies.validation_cases.iseesnow import EXTENT, MOVING

    east, cell = inputs.terrain.easting, CELLS**2
    sections = [float(frame.sum(axis=0).max()) * CELLS for frame in frames]
    return {
        "sections": [round(section, 1) for section in sections],
        "length": round(stretch(frames[-1], east)),
        "thickness": [round(mean, 2) for mean in means_along(inputs, thickness)],
        "speed": [round(mean, 1) for mean in means_along(inputs, speed)],
        "front": float(east[np.flatnonzero((speed > MOVING).any(axis=0))[-1]]),
        "area": round(1e-4 * cell * int((thickness > EXTENT).sum()), 2),
    }


def com1dfa_numbers(inputs: Any, folder: Path) -> dict[str, Any]:
    """Numbers of a run of com1DFA."""
    peaks = (read(inputs, folder / f"{name}.tif") for name in PEAKS)
    return numbers(inputs, *peaks, [read(inputs, folder / f"{MAPS[0]}_{seconds:g}.tif") for seconds in LOOKS])


def runout_numbers(inputs: Any, angle: float, law: Any) -> dict[str, Any]:
    """Numbers of a run of runout with an internal friction [deg] and a law of friction."""
    import runout
    from runout.scores import slope_normal_thickness
    from runout.studies.validation_cases.iseesnow import LEVELLED
    from runout.studies.validation_cases.iseesnow import Variant as Choice

    snow, control = Choice(CELLS, LEVELLED, angle).snow, {"snapshot_times": LOOKS, "end_time": END, "threads": 1}
    grid = {"cell_size": CELLS, "particles_per_cell": LEVELLED}
    result = runout.simulate(inputs.terrain, inputs.release(polygon=False), snow, basal_friction=law, **grid, **control)
    vertical = np.nan_to_num(result.snapshot_maps()["flow_thickness"].values)
    frames = [slope_normal_thickness(frame, np.nan_to_num(inputs.slope)) for frame in vertical]
    return {"friction_angle_deg": angle, **numbers(inputs, *inputs.peak_maps(result), frames)}


def record(out: Path) -> None:
    """Write the record of all runs of com1DFA that DIR holds, of those of runout, and of the median of the tools."""
    from docs.pages.iseesnow_terms import OTHER
    from runout.studies.validation_cases import iseesnow
    from tests.benchmarks.whole_column import WholeColumn

    inputs = iseesnow.read("IdealizedTopo")
    runs = {name: com1dfa_numbers(inputs, folder_of(out, name)) for name in VARIANTS if folder_of(out, name).is_dir()}
    standard, whole = iseesnow.voellmy(inputs.mu, inputs.xi, "column"), WholeColumn(mu=inputs.mu, xi=inputs.xi)
    own = {STANDARD: runout_numbers(inputs, 30.0, standard)}
    own |= {f"whole column, {angle:g} deg": runout_numbers(inputs, angle, whole) for angle in ANGLES}
    content = {"avaframe": AVAFRAME, "cells": CELLS, "looks": LOOKS, "com1dfa": runs, "runout": own}
    OTHER.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    print(OTHER)


if __name__ == "__main__":
    main(__doc__, run_all, record)
