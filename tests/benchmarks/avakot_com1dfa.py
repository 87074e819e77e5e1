"""Outlines and numbers of com1DFA (AvaFrame 2.1) on its site avaKot, which the validation case avakot shows beside runout.

    python3 -m venv ENV && ENV/bin/pip install avaframe==2.1
    ENV/bin/python tests/benchmarks/avakot_com1dfa.py run --out DIR
    python tests/benchmarks/avakot_com1dfa.py record --out DIR

``run`` needs AvaFrame in an environment of its own. It runs com1DFA with each law, and without some of its terms (7 runs, 6 minutes
on one core). DIR then holds peak thickness, peak speed and settings of each run. ``record`` needs runout. It computes the numbers
and writes `runout/studies/validation_cases/avakot_com1dfa.json`. Both read the site's inputs in RUNOUT_DATA/avaframe/avaKot.
com1DFA places its particles at random from a fixed seed: a second run gives the same numbers.

Configuration: AvaFrame's defaults with cells of 5 m, the stated law, type null (no entrainment or forest resistance) and no dam.
If the numbers change, run `runout validate avakot --full --out DIR`: its record holds a copy of them.
"""

import argparse
import json
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import redirect_stdout
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

AVAFRAME, SITE = "2.1", "avaframe/avaKot"
CELLS = 5.0  # [m]
STANDARD = "standard"  # with all terms
SETTINGS = {
    STANDARD: {},
    "no artificial viscosity": {"viscOption": "0"},
    "no artificial viscosity, no pressure": {"viscOption": "0", "sphOption": "0"},
    "no curvature in friction": {"curvAccInFriction": "0"},
}
PARAMETERS = {  # their letters, and their names in AvaFrame's configuration
    "samosAT": {
        **{"mu": "musamosat", "tau_0": "tau0samosat", "R_s0": "Rs0samosat"},
        **{"kappa": "kappasamosat", "B": "Bsamosat", "R": "Rsamosat"},
    },
    "Voellmy": {"mu": "muvoellmy", "xi": "xsivoellmy"},
}
RUNS = {
    "samosAT": (STANDARD, "no artificial viscosity", "no curvature in friction"),
    "Voellmy": tuple(SETTINGS),
}
PEAKS = ("pft", "pfv")  # AvaFrame's names of peak thickness normal to the slope [m] and peak speed [m/s]


def folder_of(out: Path, law: str, variant: str) -> Path:
    """Folder of a run."""
    return out / f"{law}_{variant}".replace(",", "").replace(" ", "_")


def run_all(out: Path) -> None:
    """Run com1DFA with each law and variant; one process, one after the other."""
    installed = version("avaframe")
    if installed != AVAFRAME:
        sys.exit(f"avaframe is {installed}; the record is of {AVAFRAME}: pip install avaframe=={AVAFRAME}")
    data = os.environ.get("RUNOUT_DATA")
    if data is None or not (Path(data) / SITE).is_dir():
        sys.exit(f"$RUNOUT_DATA/{SITE} is not there; set RUNOUT_DATA to the folder that holds it")
    for law, variants in RUNS.items():
        for variant in variants:
            started = time.perf_counter()
            run(Path(data) / SITE / "Inputs", law, variant, folder_of(out, law, variant))
            print(f"{law}, {variant}: {time.perf_counter() - started:.0f} s", flush=True)


def run(inputs: Path, law: str, variant: str, out: Path) -> None:
    """Run com1DFA in a temporary project; its peaks and settings go to ``out``."""
    from avaframe.com1DFA import com1DFA

    out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        project = Path(folder) / "avaKot"
        (project / "Inputs").mkdir(parents=True)
        shutil.copy(inputs / "avaKot.asc", project / "Inputs")
        shutil.copytree(inputs / "REL", project / "Inputs" / "REL")
        chosen = configuration(law, variant)
        with open(os.devnull, "w") as nowhere, redirect_stdout(nowhere):  # com1DFA prints each time step
            _, _, reports, _ = com1DFA.com1DFAMain(main_configuration(project), cfgInfo=chosen)
        peaks = project / "Outputs" / "com1DFA" / "peakFiles"
        for name in PEAKS:
            shutil.copy(only(peaks, f"*_{name}.asc"), out / f"{name}.asc")
        last = only(peaks / "timeSteps", "*_pft_t*.asc")
    numbers = {letter: float(chosen["GENERAL"][name]) for letter, name in PARAMETERS[law].items()}
    mass = float(reports[0]["Simulation Parameters"]["Final mass [kg]"])
    settings = {"parameters": numbers, "end_time": float(last.stem.rpartition("_t")[2]), "mass": mass}
    (out / "settings.json").write_text(json.dumps(settings), encoding="utf-8")


def only(folder: Path, pattern: str) -> Path:
    """The one file of a name."""
    (path,) = folder.glob(pattern)
    return path


def main_configuration(project: Path) -> Any:
    """AvaFrame's general configuration: one process, no report."""
    from avaframe.in3Utils import cfgUtils

    chosen = cfgUtils.getGeneralConfig()
    chosen["MAIN"].update(avalancheDir=str(project), nCPU="1")
    chosen["FLAGS"].update(savePlot="False", createReport="False", ReportDir="False")
    return chosen


def configuration(law: str, variant: str) -> Any:
    """com1DFA's default configuration with a law, without the terms that the variant leaves out."""
    from avaframe.com1DFA import com1DFA
    from avaframe.in3Utils import cfgUtils

    chosen = cfgUtils.getModuleConfig(com1DFA, onlyDefault=True, toPrint=False)
    chosen["GENERAL"].update(simTypeList="null", dam="False", frictModel=law, meshCellSize=f"{CELLS:g}", **SETTINGS[variant])
    return chosen


@dataclass(frozen=True)
class Peaks:
    """Peak thickness normal to the slope [m] and peak speed [m/s] of a run (rows, columns), and its cell centres [m]."""

    thickness: np.ndarray
    speed: np.ndarray
    easting: np.ndarray
    northing: np.ndarray

    def area(self, level: float) -> float:
        """Area [ha] that is thicker than a level [m]."""
        return round(1e-4 * CELLS**2 * int((self.thickness > level).sum()), 2)


def read_peaks(folder: Path) -> Peaks:
    """Peaks of a run; both are 0 where nothing flowed."""
    from runout.errors import InputError
    from runout.io.opening import open_raster

    maps = []
    for name in PEAKS:
        with open_raster(folder / f"{name}.asc", InputError) as raster:
            maps.append(np.nan_to_num(raster.read(1, masked=True).astype(float).filled(0.0)))
            west, _, _, north = raster.bounds
    rows, columns = maps[0].shape
    return Peaks(*maps, west + CELLS * (np.arange(columns) + 0.5), north - CELLS * (np.arange(rows) + 0.5))


def numbers(peaks: Peaks, line: Any) -> dict[str, Any]:
    """Numbers of a run as the validation case has them of runout; ``line`` is the path of the flow."""
    from runout.studies.validation_cases.avakot import EXTENT, LEVELS_OF_AREA, MOVING

    s, _ = line.coordinates(*np.meshgrid(peaks.easting, peaks.northing))
    return {
        "front": round(float(s[peaks.speed > MOVING].max()), 0),
        "area": peaks.area(EXTENT),
        "speed": round(float(peaks.speed.max()), 1),
        "thickest": round(float(peaks.thickness.max()), 2),
        "areas": [peaks.area(level) for level in LEVELS_OF_AREA],
    }


def variant_numbers(peaks: Peaks, standard: Peaks, line: Any) -> dict[str, Any]:
    """Numbers of a run without some terms, and the agreement of its area with that of the standard run."""
    from runout.scores import contingency, reached
    from runout.studies.validation_cases.avakot import EXTENT

    table = contingency(reached(peaks.thickness, EXTENT), reached(standard.thickness, EXTENT), CELLS**2)
    return {**numbers(peaks, line), "csi": round(table.critical_success_index, 2)}


def law_numbers(out: Path, law: str, line: Any) -> dict[str, Any]:
    """Settings, numbers and outline of the standard run with a law, and the numbers of its variants."""
    from runout.studies.validation_cases.avakot import EXTENT
    from runout.studies.validation_cases.case import outline_of

    folders = {variant: folder_of(out, law, variant) for variant in RUNS[law]}
    peaks = {variant: read_peaks(folder) for variant, folder in folders.items()}
    standard = peaks.pop(STANDARD)
    settings = json.loads((folders[STANDARD] / "settings.json").read_text(encoding="utf-8"))
    return {
        **settings,
        **numbers(standard, line),
        "outline": outline_of(standard.thickness, EXTENT, standard.easting, standard.northing, CELLS),
        "variants": {variant: variant_numbers(maps, standard, line) for variant, maps in peaks.items()},
    }


def record(out: Path) -> None:
    """Write the record of all runs."""
    from runout.studies.validation_cases.avakot import OTHER, SOURCE
    from runout.studies.validation_cases.case import data_folder, thalweg_of

    line = thalweg_of(data_folder(SITE, SOURCE) / "Inputs" / "LINES" / "path_aimec.shp")
    laws = {law: law_numbers(out, law, line) for law in RUNS}
    OTHER.write_text(json.dumps({"avaframe": AVAFRAME, "cells": CELLS, "laws": laws}) + "\n", encoding="utf-8")
    print(OTHER)


def main(text: str | None, run: Callable[[Path], None], record: Callable[[Path], None]) -> None:
    """Run com1DFA, or record its runs; ``text`` is the help."""
    parser = argparse.ArgumentParser(description=text, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("step", choices=("run", "record"))
    parser.add_argument("--out", type=Path, required=True)
    a = parser.parse_args()
    {"run": run, "record": record}[a.step](a.out)


if __name__ == "__main__":
    main(__doc__, run_all, record)
