"""Verification: closed forms, manufactured solutions and orders of convergence, as lines and a record."""

import json
import logging
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from runout.errors import ConfigError, ExitCode
from runout.io.atomic import read_json, write_json
from runout.studies.verification_cases import (
    bar,
    basal_laws,
    column,
    column_collapse,
    curved_ground,
    dam_breaks,
    element,
    eroded_layer,
    granular_slope,
    ground_contact,
    hydrograph_inflow,
    manufactured,
    mud_slope,
    rigid,
    single_precision,
    sliding_box,
    spreading_cap,
    terrain_distance,
    thin_layers,
    transfers,
    wet_layers,
    zone_crossing,
)
from runout.studies.verification_cases.finding import Case, Finding, as_json, as_lines, finding_of
from runout.studies.work_precision import commit

LOGGER = logging.getLogger("runout.verification")
FILE = "verification.json"
CASES: dict[str, Case] = {
    case.name.lower(): case
    for case in (
        *(transfers.WEIGHTS, transfers.CONSERVATION, transfers.AFFINE, rigid.FALL, rigid.SPIN, bar.CASE),
        *(manufactured.WAVES, manufactured.VORTEX, column.CASE, element.CASE, sliding_box.CASE),
        *(ground_contact.THRESHOLD, ground_contact.OBLIQUE, ground_contact.GAP),
        *(curved_ground.BOWL, curved_ground.RAMP, terrain_distance.CASE, thin_layers.CASE, single_precision.CASE),
        *(basal_laws.DRAG, basal_laws.WEAKENING, zone_crossing.CASE, wet_layers.CASE),
        *(dam_breaks.DRY, dam_breaks.SLOPE_CASE, spreading_cap.CASE),
        *(column_collapse.COLUMNS, column_collapse.BUI, granular_slope.CASE, mud_slope.CASE, eroded_layer.CASE),
        hydrograph_inflow.CASE,
    )
}


def run(cases: Sequence[str] = (), full: bool = False, out: Path | None = None) -> list[Finding]:
    """Findings of cases of verification, in order: of those named in :data:`CASES`, in upper or lower case, or of all.

    A ``full`` run has the sizes of the documentation (about an hour), otherwise those of CI (about two minutes). With a folder
    ``out`` the record :data:`FILE` is rewritten in it after each case. An interrupted run continues after its last complete case
    if the code is the same. A complete run is measured again. Raises ConfigError if there is no case of a name.
    """
    asked = [_named(name) for name in cases or CASES]
    code = {"full": full, "cases_asked": [case.name for case in asked], "commit": commit()}
    done = _unfinished(out / FILE, code) if out is not None else {}
    findings = []
    for case in asked:
        if case.name in done:
            findings.append(done[case.name])
            LOGGER.info("%s: finding of the interrupted run is used", case.name)
            continue
        started = time.perf_counter()
        results = tuple(case.measure(full))
        findings.append(Finding(case, results, time.perf_counter() - started))
        LOGGER.info("%s", "\n".join(as_lines(findings[-1])))
        if out is not None:
            _write(findings, cases, code, out)
    return findings


def _unfinished(record: Path, code: Mapping[str, Any]) -> dict[str, Finding]:
    """Findings by name of an interrupted run of the same code; empty if there is none."""
    content = read_json(record)
    same = {name: content.get(name) for name in code} == dict(code)
    if not same or len(content["cases"]) == len(code["cases_asked"]):
        return {}
    return {case["name"]: finding_of(case, CASES[case["name"].lower()]) for case in content["cases"]}


def run_plane(
    slope: float = 20.0,
    azimuth: float = 0.0,
    offset: float = 0.35,
    precision: str = "float64",
    settled: bool = True,
    full: bool = False,
) -> dict[str, Any]:
    """Errors of the sliding box on one plane, with its set-up and the seconds taken.

    Angles in degrees, the offset in cells above a node; ``settled`` False starts from the stresses of a slab, unbalanced on the
    box's free faces. Keys as in :func:`sliding_box.summary`. Raises ConfigError if an angle or the offset is out of its range.
    """
    spacing = 0.05 if full else 0.1
    plane = sliding_box.Plane(slope, azimuth, offset, spacing, precision=precision, settled=settled)
    started = time.perf_counter()
    row = sliding_box.summary(plane)
    LOGGER.info("sliding box at %g deg, azimuth %g deg, %g h off a node: %s", slope, azimuth, offset, row)
    parameters = asdict(plane)
    setup = {"size": sliding_box.SIZE, "friction_angle_deg": sliding_box.FRICTION_ANGLE, **parameters.pop("body"), **parameters}
    return {"case": "sliding-box", **row, "setup": setup, "seconds": time.perf_counter() - started}


def command(
    cases: Sequence[str], full: bool, out: Path | None, json_file: Sequence[Path] | None, plane: Mapping[str, Any]
) -> ExitCode:
    """Command ``runout verify``: runs the cases, or the sliding box on one ``plane``, and writes or prints the findings.

    ``json_file`` holds no path to print JSON on standard output, one to write it there; None for neither. Raises ConfigError if a
    plane is given for other cases than the sliding box, and as :func:`run`.
    """
    if not plane:
        findings = run(cases, full, out)
        content, holds = as_json(findings, full), all(f.holds for f in findings)
    elif [name.lower() for name in cases] == ["sliding-box"]:
        content, holds = run_plane(**plane, full=full), True
    else:
        raise ConfigError(f"{', '.join(plane)} belong to the sliding box alone; say `runout verify sliding-box ...`")
    if json_file:
        write_json(content, json_file[0])
    elif json_file is not None:
        print(json.dumps(content, indent=2))
    return ExitCode.OK if holds else ExitCode.FAILURE


def _named(name: str) -> Case:
    if name.lower() not in CASES:
        raise ConfigError(f"there is no case {name!r}; choose among {', '.join(case.name for case in CASES.values())}")
    return CASES[name.lower()]


def _write(findings: Sequence[Finding], cases: Sequence[str], code: Mapping[str, Any], out: Path) -> None:
    """Write the record, completely or not at all."""
    command = " ".join(["runout verify", *cases, *(["--full"] if code["full"] else []), "--out DIR"])
    content = {**as_json(findings, code["full"]), **code, "command": command}
    written = write_json(content, out / FILE)
    if len(findings) == len(code["cases_asked"]):
        LOGGER.info("wrote %s", written)
