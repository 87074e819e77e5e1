"""Text of the page of the case Frank Slide, and its numbers."""

from collections.abc import Mapping
from typing import Any

import numpy as np

DIFFERENCES = """\
- **The mass moves alike.** Centroids differ by {centroid:.1f} cells at most. Kinetic energies from 10 to 30 s agree within
  {energy:.1f} %.
- **At 20 s and 15 deg the front lags by {lag:.0f} m and the rear is {ahead:.0f} m ahead: the mass is shorter, not slower.** Cells
  of {fine:g} m change the lag by {finer:.0f} m. Less internal friction does more. SHALTOP has hydrostatic pressure, which
  stretches the mass; {angle:g} deg of internal friction resist that. With {least:g} deg, the least that passes on 15 deg at the
  base, the lag is {least_lag:.0f} m at 20 s. At 30 s it is {later:.0f} m (negative: ahead) in place of {late:.0f} m, and CSI at 5
  m and 20 s is {csi_least:.2f} in place of {csi:.2f}.
- **{early_least:.0f} to {early_most:.0f} m of the lag arise in the first 10 s, with any of these internal frictions and cells.**
  The pile is up to {pile:.0f} m thick and steep there. In SHALTOP its full weight drives it at once, whatever its vertical
  acceleration. In three dimensions the mass has to fall first.
- No parameter was fitted to SHALTOP: {angle:g} deg is the value of `sites/frank_slide`.
- SHALTOP is a model, not an observation. The outline of the true deposit does not come with these data."""


def numbers(results: Mapping[str, Any]) -> dict[str, float]:
    """Numbers of the text: those of frames 1 to 3 are at 10, 20 and 30 s."""
    from runout.studies.validation_cases.frank_slide import SHALTOP_ENERGY

    runs, studies = results["runs"], results["studies"]
    run = next(r for r in runs if r["basal_friction_deg"] == 15)
    least = min(studies, key=lambda r: r["friction_angle_deg"])
    fine = min(studies, key=lambda r: r["cell_size"])
    known = np.array(SHALTOP_ENERGY[15])[1:4]
    apart = [np.abs(np.subtract(r["runout"]["centroid"], r["shaltop"]["centroid"])).max() for r in runs]
    early = [lag(r, 1) for r in (run, *studies)]
    return {
        "centroid": max(apart) / run["cell_size"],
        "energy": 100.0 * float(np.abs(np.array(run["kinetic_energy"])[1:4] / known - 1.0).max()),
        "lag": lag(run, 2), "ahead": run["runout"]["rear"][2] - run["shaltop"]["rear"][2],
        "fine": fine["cell_size"], "finer": abs(lag(fine, 2) - lag(run, 2)),
        "angle": run["friction_angle_deg"], "least": least["friction_angle_deg"],
        "least_lag": lag(least, 2), "late": lag(run, 3), "later": lag(least, 3),
        "csi": run["csi"][2][1], "csi_least": least["csi"][2][1],
        "early_least": min(early), "early_most": max(early), "pile": run["runout"]["thickest"][0],
    }  # fmt: skip


def lag(run: Mapping[str, Any], frame: int) -> float:
    """Distance [m] of the front of a run behind that of SHALTOP in a frame."""
    return float(run["shaltop"]["front"][frame] - run["runout"]["front"][frame])
