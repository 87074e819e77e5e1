"""Sliding box and collapsing columns of the verification, at the angles of the published benchmarks."""

from dataclasses import replace
from typing import Any

from runout.studies.verification_cases.closed_forms import sliding_block
from runout.studies.verification_cases.column_collapse import REPOSE, planar, planar_envelope, sand
from runout.studies.verification_cases.sliding_box import Plane, summary
from tests.benchmarks.seed_cases.published import FRICTION_ANGLES, SLOPES

BOX = Plane(slope_deg=0.0, azimuth_deg=37.0)  # across the axes of the grid, not at a node
TIME = 1.0  # [s] of a slide
ASPECT = 2.0  # height of a column over its length


def slides(full: bool) -> list[dict[str, Any]]:
    """One row a slope: displacement [m] after :data:`TIME` beside that of a rigid block, and speed [m/s] beyond its speed."""
    spacing = 0.05 if full else 0.1
    return [_slide(replace(BOX, slope_deg=slope, spacing=spacing)) for slope in SLOPES]


def _slide(plane: Plane) -> dict[str, Any]:
    numbers = summary(plane, TIME)
    exact, _ = sliding_block(TIME, plane.slope_deg, plane.friction)
    return {"slope_deg": plane.slope_deg, "cell": plane.spacing, "rigid_block": float(exact), **numbers}


def collapses(full: bool) -> list[dict[str, Any]]:
    """One row a friction angle: run-out of 99 % of a column between walls over its length [1], and its largest thickness [1].

    ``law``: least and largest run-out of experiments with sand, whose angle of repose is about 30 degrees; none for other angles.
    """
    cells = 32 if full else 8
    return [_collapse(angle, cells) for angle in FRICTION_ANGLES]


def _collapse(angle: float, cells: int) -> dict[str, Any]:
    runout, frame = planar(ASPECT, cells, sand(ASPECT, angle))
    return {
        "friction_angle_deg": angle,
        "aspect": ASPECT,
        "cells": cells,
        "runout": runout,
        "height_m": float(frame.thickness.max()),
        "law": list(planar_envelope(ASPECT)) if angle == REPOSE else None,
    }
