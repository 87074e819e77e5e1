"""Collapse of columns: the aluminium rods of Bui et al. 2008, and sand of 20, 30 and 40 deg against run-out laws of experiments.

The runs are those of :mod:`runout.studies.verification_cases.column_collapse`.
"""

import csv
import os
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from runout.materials.drucker_prager import Cone
from runout.studies.validation_cases.case import data_folder, rounded
from runout.studies.verification_cases import flow
from runout.studies.verification_cases.closed_forms import axisymmetric_runout
from runout.studies.verification_cases.column_collapse import (
    HEIGHT,
    LENGTH,
    SCATTER,
    held_by,
    planar,
    planar_envelope,
    rods,
    round_column,
    sand,
)
from runout.studies.verification_cases.flow import Frame

SOURCE = "Bui et al. 2008, doi 10.1002/nag.688, as digitised in github.com/LandslideSIM/MaterialPointSolver.jl (MIT)"
WIDE = 1.2  # [m], domain of the rods
MOVED = (0.5e-3, 1e-3, 2e-3)  # displacements [m] from which a rod counts as moved; the second is that of the failure line
ANGLES = (20.0, 30.0, 40.0)  # [deg] internal friction


def points(name: str) -> np.ndarray:
    """Points (n, 2) [m] of one of the files of the rods."""
    folder = data_folder(".", SOURCE)
    rows = (folder / f"bui2008_{name}.csv").read_text(encoding="utf-8").splitlines()
    return np.array([row.split(",") for row in rows if row[:1].isdigit()], float)


def failure_line(frame: Frame, spacing: float, at: np.ndarray, moved: float) -> np.ndarray:
    """Height [m] of the rods that moved less than ``moved`` [m] at places (n,) [m] from the wall; mean of both sides.

    A place takes the columns of rods within half a cell, and half the distance of two rods above the highest.
    """
    start = flow.rectangle(2 * LENGTH, HEIGHT, spacing, WIDE / 2 - LENGTH)
    p = frame.particles
    now = p.position(np.full(3, spacing))[:, [0, 2]] - (0.0, flow.BASE * spacing)
    first = start[p.identity % len(start)]
    still = np.hypot(*(now - first).T) < moved
    away, height = np.abs(first[:, 0] - WIDE / 2), first[:, 1]
    heights = [height[still & (np.abs(away - x) <= spacing / 2)] for x in at]
    return np.array([h.max() + spacing / 4 if h.size else 0.0 for h in heights])


def measure_rods(spacing: float) -> dict[str, Any]:
    """Surface and failure line of the rods against the experiment."""
    surface, failure = points("final_surface"), points("failure_surface")
    started = time.process_time()
    frame, x, thickness = rods(spacing, 1.0, 1)
    seconds = time.process_time() - started
    lines = [failure_line(frame, spacing, failure[:, 0], moved) for moved in MOVED]
    away = np.sort(np.abs(frame.particles.position(np.full(3, spacing))[:, 0] - WIDE / 2))
    return {
        "spacing": spacing,
        "seconds": seconds,
        "front": float(away[int(0.99 * len(away))]),
        "surface_rms": rms(np.interp(surface[:, 0], x, thickness) - surface[:, 1]),
        "failure_rms": [rms(line - failure[:, 1]) for line in lines],
        "failure_bias": [float((line - failure[:, 1]).mean()) for line in lines],
        "surface": [rounded(x, 4), rounded(thickness, 4)],
        "failure": [rounded(failure[:, 0], 4), rounded(lines[1], 4)],
    }


def rms(difference: np.ndarray) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(difference**2)))


def measure_sand(shape: str, aspects: Sequence[float], cells: int) -> list[dict[str, Any]]:
    """Run-out of columns of sand of each angle, beside the law or envelope of experiments."""
    rows = []
    for aspect in aspects:
        low, high = planar_envelope(aspect) if shape == "planar" else round_envelope(aspect)
        for angle in ANGLES:
            started = time.process_time()
            deposit = _planar(aspect, cells, angle) if shape == "planar" else _round(aspect, cells, angle)
            seconds = time.process_time() - started
            row = {"shape": shape, "aspect": aspect, "friction_angle_deg": angle, "runout": deposit, "low": low, "high": high}
            rows.append({**row, "cells": cells, "seconds": seconds})
    return rows


def round_envelope(aspect: float) -> tuple[float, float]:
    """Least and most run-out of round columns in experiments, with their scatter."""
    law = axisymmetric_runout(aspect)
    return (1 - SCATTER) * law, (1 + SCATTER) * law


def _planar(aspect: float, cells: int, angle: float) -> float:
    return planar(aspect, cells, sand(aspect, angle))[0]


def _round(aspect: float, cells: int, angle: float) -> float:
    floor = {"friction": (held_by(sand(aspect, angle), angle),)}
    return round_column(aspect, cells, Cone.PLANE_STRAIN, "float32", floor, angle).runout


def experiments() -> dict[str, list[list[float]]]:
    """Aspect ratio and run-out of round columns, by series: an experiment of unnamed origin and another MPM code."""
    series: dict[str, list[list[float]]] = {}
    path = Path(os.environ["RUNOUT_DATA"]) / "axisymmetric_column_runout.csv"
    with open(path, encoding="utf-8") as file:
        for name, aspect, runout in csv.reader(line for line in file if not line.startswith(("#", "series"))):
            series.setdefault(name, []).append([float(aspect), float(runout)])
    return series


def measure(full: bool) -> dict[str, Any]:
    """Rods at 10, 5 and 2.5 mm and sand in both shapes; in CI rods at 10 mm and one planar column per angle."""
    shown = [measure_rods(h) for h in ((0.01, 0.005) if full else (0.01,))]
    rows = measure_sand("planar", (1.0, 2.0) if full else (1.0,), 8)
    if full:
        rows += measure_sand("round", (1.0,), 8)
    surface, failure = points("final_surface").tolist(), points("failure_surface").tolist()
    return {
        "rods": shown,
        "experiment": {"surface": surface, "failure": failure},
        "sand": rows,
        "round_series": experiments(),
        "lines": [*map(_rods_line, shown), *map(_sand_line, rows)],
    }


def _rods_line(row: dict[str, Any]) -> str:
    return (
        f"  rods, {1e3 * row['spacing']:g} mm: surface {1e3 * row['surface_rms']:.1f} mm RMS, failure line "
        f"{1e3 * row['failure_rms'][1]:.1f} mm RMS, {row['seconds']:.0f} s"
    )


def _sand_line(row: dict[str, Any]) -> str:
    return (
        f"  {row['shape']} column, a = {row['aspect']:g}, {row['friction_angle_deg']:g} deg: run-out {row['runout']:.2f} "
        f"(experiments {row['low']:.2f} to {row['high']:.2f}), {row['seconds']:.0f} s"
    )
