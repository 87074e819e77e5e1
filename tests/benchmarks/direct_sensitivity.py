"""Sobol indices by an emulator of few members beside those of a direct study of many runs.

    python -m tests.benchmarks.direct_sensitivity --out DIR [--device cuda:0] [--cell-size 40] [--base 64] [--members 32 64]

The site is jacksboro with four sampled parameters on cells of 40 m. The direct study runs Saltelli's sample as a table of members:
``base`` times (parameters + 2) runs, 384 by default, all with one seed of the particles. ``runout sensitivity`` takes 32 and 64
members of a Sobol net. The script prints one table and writes ``direct_sensitivity.json``. An index agrees if the intervals of 90 %
of both studies overlap within 0.01; that of the direct study is SALib's bootstrap. On a CPU a run takes about a second.
"""

import argparse
import json
import subprocess
import time
from pathlib import Path
from shutil import copytree, ignore_patterns
from typing import Any

import numpy as np
import pandas as pd
import yaml
from SALib.analyze import sobol

import runout
from runout import cli
from runout.calibration.prior import Prior
from runout.calibration.sobol_indices import saltelli_problem, saltelli_sample
from runout.workflow.sensitivity import QUANTITIES, finished_members, member_scalars
from runout.workflow.study import Study

ROOT = Path(__file__).parents[2]
RECORD = "direct_sensitivity.json"
PARAMETERS = {
    "basal_friction_angle_deg": (13.0, 16.0),
    "release_volume_factor": (0.5, 1.2),
    "friction_angle_deg": (28.0, 40.0),
    "density": (1800.0, 2200.0),
}
SEED = 7  # of the particles of every run of the direct study
CONFIDENCE = 0.9
TOLERANCE = 0.01  # between intervals: indices of a parameter without effect are about 1e-5, with intervals as short


def write_site(folder: Path, cell_size: float, ensemble: dict[str, Any]) -> Path:
    """The site with other cells and another ensemble."""
    copytree(ROOT / "sites" / "jacksboro", folder, dirs_exist_ok=True, ignore=ignore_patterns("results"))
    settings = yaml.safe_load((folder / "site.yaml").read_text(encoding="utf-8"))
    settings["simulation"] |= {"cell_size": cell_size, "end_time": 120, "stop_when_at_rest": False}
    settings["ensemble"] = ensemble
    settings["budget"] = {"hours": 10, "memory_gb": 8, "disk_gb": 4}
    (folder / "site.yaml").write_text(yaml.safe_dump(settings, sort_keys=False), encoding="utf-8")
    return folder


def sampled(members: int) -> dict[str, Any]:
    """Block ``ensemble`` that samples the parameters."""
    ranges = {name: {"distribution": "uniform", "low": low, "high": high} for name, (low, high) in PARAMETERS.items()}
    return {"members": members, "seed": 1, "parameters": ranges}


def run_members(site: Path, device: str | None) -> float:
    """Seconds of ``runout ensemble``; members that have run count nothing."""
    started = time.perf_counter()
    code = cli.main(["ensemble", str(site), *(() if device is None else ("--device", device))])
    assert code == 0, f"runout ensemble ended with {code}"
    return time.perf_counter() - started


def direct_study(out: Path, cell_size: float, base: int, device: str | None) -> tuple[dict[str, Any], float]:
    """Indices by quantity and parameter with the half widths of their intervals, and seconds of the runs."""
    prior = Prior.of(runout.read_site(write_site(out / "prior", cell_size, sampled(32))))
    table = pd.DataFrame(prior.values(saltelli_sample(prior, base)), columns=list(prior.names))
    site = write_site(out / "direct", cell_size, {"table": "inputs/saltelli.csv"})
    table.assign(seed=SEED).to_csv(site / "inputs" / "saltelli.csv", index=False)
    seconds = run_members(site, device)
    study = Study.open(site, device=device)
    members = finished_members(study)
    assert len(members) == len(table), f"{len(members)} of {len(table)} runs have a result"
    scalars = member_scalars(study.site, study.results, members)
    return {name: _direct_indices(scalars[name], prior) for name in QUANTITIES}, seconds


def _direct_indices(values: np.ndarray, prior: Prior) -> dict[str, dict[str, float]]:
    indices = sobol.analyze(saltelli_problem(prior), values, calc_second_order=False, conf_level=CONFIDENCE, seed=0)
    columns = {"first": "S1", "first_half_width": "S1_conf", "total": "ST", "total_half_width": "ST_conf"}
    return {name: {key: float(indices[one][k]) for key, one in columns.items()} for k, name in enumerate(prior.names)}


def emulated_study(out: Path, cell_size: float, members: int, device: str | None) -> tuple[dict[str, Any], float]:
    """Content of ``sensitivity.json`` and seconds of the runs."""
    site = write_site(out / f"members_{members}", cell_size, sampled(members))
    seconds = run_members(site, device)
    assert cli.main(["sensitivity", str(site)]) == 0
    return json.loads((site / "results" / "sensitivity" / "sensitivity.json").read_text(encoding="utf-8")), seconds


def compared(direct: dict[str, Any], emulated: dict[int, dict[str, Any]]) -> list[dict[str, Any]]:
    """A row for each quantity, parameter, kind of index and number of members."""
    rows = []
    for quantity, by_parameter in direct.items():
        for members, record in emulated.items():
            one = record["quantities"].get(quantity)
            for (parameter, own), kind in ((pair, kind) for pair in by_parameter.items() for kind in ("first", "total")):
                row = {"quantity": quantity, "parameter": parameter, "index": kind, "members": members, "direct": own[kind]}
                row["half_width"] = own[f"{kind}_half_width"]
                if one is not None:
                    low, high = one["parameters"][parameter][f"{kind}_5_95"]
                    value = one["parameters"][parameter][kind]
                    apart = max(low - own[kind], own[kind] - high) - row["half_width"]
                    row |= {"emulated": value, "low": low, "high": high, "agrees": bool(apart <= TOLERANCE)}
                rows.append(row)
    return rows


def print_table(rows: list[dict[str, Any]]) -> None:
    """One line for each index."""
    print(f"{'quantity':17}{'parameter':26}{'index':7}{'members':>8}{'direct':>18}{'emulated':>24}  agrees")
    for row in rows:
        emulated = "refused"
        if "emulated" in row:
            emulated = f"{row['emulated']:.3f} ({row['low']:.3f} to {row['high']:.3f})"
        direct = f"{row['direct']:.3f} +- {row['half_width']:.3f}"
        agrees = {True: "yes", False: "NO", None: "-"}[row.get("agrees")]
        print(f"{row['quantity']:17}{row['parameter']:26}{row['index']:7}{row['members']:8}{direct:>18}{emulated:>24}  {agrees}")
    judged = [row for row in rows if "agrees" in row]
    print(f"{sum(row['agrees'] for row in judged)} of {len(judged)} indices agree")


def main() -> None:
    """Run both studies, print the table and write the record."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--device")
    parser.add_argument("--cell-size", type=float, default=40.0, help="[m]")
    parser.add_argument("--base", type=int, default=64, help="a power of two")
    parser.add_argument("--members", type=int, nargs="+", default=[32, 64])
    a = parser.parse_args()
    direct, seconds = direct_study(a.out, a.cell_size, a.base, a.device)
    studies = {members: emulated_study(a.out, a.cell_size, members, a.device) for members in a.members}
    rows = compared(direct, {members: record for members, (record, _) in studies.items()})
    print_table(rows)
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=True)
    record = {
        "runout": runout.__version__, "commit": commit.stdout.strip(), "command": "python -m tests.benchmarks.direct_sensitivity",
        "device": a.device or "cpu", "cell_size": a.cell_size, "runs": a.base * (len(PARAMETERS) + 2), "parameters": PARAMETERS,
        "seconds": {"direct": seconds, **{str(members): spent for members, (_, spent) in studies.items()}},
        "held_out_q2": {
            members: {name: one["held_out_q2"] for name, one in content["quantities"].items()}
            for members, (content, _) in studies.items()
        },
        "rows": rows,
    }  # fmt: skip
    (a.out / RECORD).write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
