"""Steps of the members of a site, and depth of their flows, without a run: points slide in place of the mass."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.model import basal_strength
from runout.model.column_resistance import ColumnResistance, Resistance, ground_below, resting_resistance
from runout.model.depth_resolution import DepthResolution
from runout.model.friction_laws import DEFAULT_FRICTION
from runout.model.limits import spacing_of
from runout.model.numerics import Scheme
from runout.model.scene import Raster, Scene
from runout.release.inlet import mass_at
from runout.simulation.observers import AtRest
from runout.terrain.energy_line import GATHERED
from runout.terrain.sliding_points import Slide, forecast_depth, lateral_pressure, slide
from runout.workflow.check_physics import samples_of
from runout.workflow.check_stiffness import VOLUME, member_stiffness

if TYPE_CHECKING:
    from runout.config.site import Site
    from runout.ensemble.member import Member
    from runout.forecast.stiffness import Stiffness
    from runout.model.materials import Material
    from runout.model.release import Release

EXACT = 5  # members whose points slide; the others follow from the speed of their flow
SETTLING = 1.15  # duration of a flow over that of points: it comes to rest grain by grain
STEP_RATIO = 1.02  # limit of the time step over the mean step, which is chosen from a ladder


@dataclass(frozen=True)
class Flow:
    """A flow until it rests or ends."""

    duration: float  # time until it rests or ends [s]
    path: float  # way of its fastest point [m]
    share: float = 1.0  # mean share of its mass that is on the terrain [1]


@dataclass(frozen=True)
class MemberSteps:
    """Steps of one member, and its particle-steps per particle at the start."""

    steps: float
    per_particle: float


def masses_of(arguments: Mapping[str, Any]) -> "list[Release]":
    """Releases of a member with these arguments of :func:`runout.simulate`, and the masses of its inflows at their lines."""
    return [*arguments["release"], *map(mass_at, arguments.get("inflow", ()))]


def flows_of(arguments: Sequence[Mapping[str, Any]], largest_speed: float) -> list[Flow]:
    """Flows of members with these arguments of :func:`runout.simulate`, by points that slide in place of the mass.

    The fastest flow reaches about ``largest_speed`` [m/s]. Members of one volume slide together.
    """
    flows: dict[int, Flow] = {}
    volumes = [tuple(r.volume for r in masses_of(member)) for member in arguments]
    for volume in dict.fromkeys(volumes):
        alike = [k for k, other in enumerate(volumes) if other == volume]
        flows |= zip(alike, _flows_from_one_scar([arguments[k] for k in alike], largest_speed), strict=True)
    return [flows[k] for k in range(len(arguments))]


def _flows_from_one_scar(arguments: Sequence[Mapping[str, Any]], largest_speed: float) -> list[Flow]:
    first, releases = arguments[0], masses_of(arguments[0])
    spacing, end_time = spacing_of(first["cell_size"]), float(first["end_time"])
    thickness = [GATHERED * float(r.thickness[r.thickness > 0].mean()) for r in releases]
    resistance = _resistance(arguments, spacing[2], largest_speed, thickness)
    drags = isinstance(resistance, ColumnResistance) and resistance.law.drags  # else thickness does not change the motion
    slides = slide(releases, resistance, len(arguments), spacing[:2], end_time, most=thickness if drags else None)
    settling = 1.0 if drags else SETTLING  # points with drag slow down one by one as the mass does
    lasting = max((one.hydrograph.end for one in first.get("inflow", ())), default=0.0)
    return [_flow(slides, k, end_time, settling if first["stop"] else None, lasting) for k in range(len(arguments))]


def depth_of_flow(arguments: Mapping[str, Any], flow_speed: float) -> float:
    """Depth [m] of the flow of a member with these arguments of :func:`runout.simulate`; it reaches about ``flow_speed`` [m/s]."""
    releases, spacing = masses_of(arguments), spacing_of(arguments["cell_size"])
    thickness = [float(r.thickness[r.thickness > 0].mean()) for r in releases]
    resistance = _resistance([arguments], spacing[2], flow_speed, thickness)
    pressure = lateral_pressure([r.material or arguments["material"] for r in releases])
    return forecast_depth(releases, resistance, pressure, spacing[:2], float(arguments["end_time"]), thickness)


def least_resolved(site: "Site", members: "Sequence[Stiffness]") -> DepthResolution:
    """Forecast resolution of the flow with the fewest cells through its depth, from the stiffness of all ``members`` of a site.

    Flows become thinner the faster they are and the less volume they have: the fastest member of all and of the least volume count.
    """
    samples = samples_of(site)
    volumes = np.array([sample.get(VOLUME, 1.0) for sample in samples])
    speeds = np.array([one.flow_speed for one in members])
    chosen = {int(speeds.argmax()), int(np.where(volumes == volumes.min(), speeds, -1.0).argmax())}
    resolutions = []
    for k in sorted(chosen):
        arguments = site.member_arguments(samples[k])
        scene = _scene(arguments, members[k].materials)
        step, speed = scene.stable_step(0.0), members[k].flow_speed
        transfer = step * scene.substep_count(step, speed)
        resolutions.append(DepthResolution.of(depth_of_flow(arguments, speed), scene, transfer))
    return min(resolutions, key=lambda one: one.depth)


def _flow(slides: Slide, k: int, end_time: float, settling: float | None, lasting: float = 0.0) -> Flow:
    """Flow of member k; ``settling`` is its duration over that of points, None for a run that ends at ``end_time`` [s].

    The last of its mass starts after the time ``lasting`` [s] of an inflow.
    """
    time, speed = slides.time, slides.speed[:, k]
    over = (_rests(speed) if settling else np.zeros(len(time), bool)) | (slides.share[:, k] == 0)
    last = int(np.argmax(over)) if over.any() else len(time) - 1
    weights, duration = np.diff(time[: last + 1], prepend=0.0), float(time[last])
    if settling and (over.any() or time[-1] < end_time * (1 - 1e-6)):
        duration *= settling
    duration = min(duration + lasting, end_time) if settling else end_time
    fastest, share = (np.average(one[: last + 1, k], weights=weights) for one in (slides.fastest, slides.share))
    return Flow(duration, float(fastest) * duration, float(share))


def _resistance(arguments: Sequence[Mapping[str, Any]], height: float, fastest: float, thickness: Sequence[float]) -> Resistance:
    """Resistance of the ground in each member, to columns of a ``thickness`` [m] of each release."""
    grounds = []
    for member in arguments:
        basal = member.get("basal_friction") or math.radians(member["basal_friction_angle"])
        masses, bed = masses_of(member), member.get("bed")
        materials = [r.material or member["material"] for r in masses]
        frictions = basal_strength.frictions_under(masses, basal)
        strengths = basal_strength.forecast_strengths(materials, masses, height)
        effective = basal_strength.effective_shares(masses, bed.pore_pressure_ratio if bed else None)
        grounds.append(ground_below(materials, frictions, strengths, member["friction_zones"], effective))
    if grounds[0].law.name == DEFAULT_FRICTION:
        return resting_resistance(grounds)
    return ColumnResistance(grounds, thickness, fastest)


def _rests(speed: np.ndarray) -> np.ndarray:
    """Whether a flow with a root mean square speed (n,) [m/s] rests, by the rule of :class:`runout.simulation.observers.AtRest`."""
    rule = AtRest()
    limit = np.minimum(math.sqrt(rule.share) * np.maximum.accumulate(speed), rule.floor_speed)
    slow = speed < np.maximum(limit, 1e-2 * rule.floor_speed)
    return slow & (np.diff(speed, prepend=speed[:1]) <= 0)  # type: ignore[no-any-return]


def member_steps(site: "Site", members: "Sequence[Member]") -> list[MemberSteps]:
    """Steps of each member."""
    data = site.data()
    stiffnesses = member_stiffness(site, data.masses, data.friction_zones, [m.parameters for m in members])
    speeds = np.array([s.flow_speed for s in stiffnesses])
    chosen = np.unique(np.argsort(speeds)[np.linspace(0, len(members) - 1, min(EXACT, len(members))).round().astype(int)])
    chosen = chosen[np.argsort(speeds[chosen])]
    arguments = [site.member_arguments(members[k].parameters) for k in chosen]
    flows = flows_of(arguments, float(speeds.max()))
    columns = np.array([[f.duration, f.path, f.share] for f in flows]).T
    between = [np.interp(speeds, speeds[chosen], column) for column in columns]
    for k, flow in zip(chosen, flows, strict=True):
        for row, value in zip(between, (flow.duration, flow.path, flow.share), strict=True):
            row[k] = value
    rows = [row.tolist() for row in between]
    return [_steps(arguments[0], one, Flow(*flow)) for one, *flow in zip(stiffnesses, *rows, strict=True)]


def _steps(grid: Mapping[str, Any], stiffness: "Stiffness", flow: Flow) -> MemberSteps:
    """Steps of a flow in which pressure waves pass a cell in the time that the Courant number leaves."""
    scene = _scene(grid, stiffness.materials)
    steps = STEP_RATIO * (flow.duration + flow.path / scene.wave_speed) / scene.stable_step(0.0)
    return MemberSteps(steps, steps * flow.share)


def _scene(grid: Mapping[str, Any], materials: "Sequence[Material]") -> Scene:
    """Scene without ground, for the step and the resolution that it gives."""
    return Scene(
        spacing_of(grid["cell_size"]), None, Raster(1, 1, (1.0, 1.0)), tuple(materials), (0.0,) * len(materials),
        **Scheme.of(grid).scheme(),
    )  # fmt: skip
