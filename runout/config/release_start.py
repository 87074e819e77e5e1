"""Start of releases: what site.yaml states of time, velocity and trigger, and what an ensemble samples of each release."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Discriminator, Field, Tag

from runout.config.distributions import Settings, limited, quantity, shape
from runout.config.friction import OF_RELEASE
from runout.config.quantities import within
from runout.config.wording import choice_fix
from runout.model.limits import LIMITS, Range, is_number

if TYPE_CHECKING:
    from runout.model.release import Release

TIME, VELOCITY, TRIGGER = "start_time", "velocity", "starts_when"
KEYS = (TIME, VELOCITY, TRIGGER)
SPEED = "start_speed"  # of a release, a parameter of an ensemble as is the time
RANGES: dict[str, Range] = {TIME: LIMITS["start_time"], SPEED: LIMITS["release_speed"]}


class ArrivalSettings(Settings):
    """A release starts when the flow of another one arrives."""

    arrives: str = quantity("name of the release whose flow arrives inside the outline of this one", min_length=1)
    thickness: float = limited("arrival_threshold", "thickness of that flow from which this release starts", 0.1)


class VelocitySettings(Settings):
    """Speed and direction of a release at its start."""

    speed: float = limited("release_speed", "speed along the ground")
    azimuth_deg: float | None = limited(
        "azimuth", "direction, clockwise from north; by default that in which the ground below the release descends", None
    )


Component = Annotated[float, Field(ge=-LIMITS["release_speed"].high, le=LIMITS["release_speed"].high)]
Velocity = Annotated[
    Annotated[float, within("release_speed"), Tag("<number>")]
    | Annotated[VelocitySettings, Tag("<block>")]
    | Annotated[list[Component], Field(min_length=3, max_length=3), Tag("<list>")],
    Discriminator(shape),
]
START_TIME: Any = limited(
    TIME,
    "time at which this mass starts to move; until then an excavated mass is ground, one on the surface is not there",
    None,
    examples=[12.0],
)
START_VELOCITY: Any = quantity(
    "velocity at the start: a speed down the slope, {speed, azimuth_deg}, or [east, north, up]", None, unit="m/s", examples=[8.0]
)
STARTS_WHEN: Any = quantity(
    "instead of start_time: this mass starts when the flow of another release arrives, {arrives: NAME, thickness: 0.1}; if it "
    "never does, the mass stays out",
    None,
    examples=[{"arrives": "upper", "thickness": 0.1}],
)


def start_of(settings: Any) -> dict[str, Any]:
    """Start time [s], velocity and trigger of the settings of a release, as :class:`runout.Release` takes them, where stated."""
    from runout.model.release_start import Arrival, StartVelocity

    start: dict[str, Any] = {}
    if settings.start_time is not None:
        start[TIME] = settings.start_time
    if isinstance(settings.velocity, VelocitySettings):
        start[VELOCITY] = StartVelocity(**settings.velocity.model_dump())
    elif settings.velocity is not None:
        start[VELOCITY] = tuple(settings.velocity) if isinstance(settings.velocity, list) else settings.velocity
    if settings.starts_when is not None:
        start[TRIGGER] = Arrival(**settings.starts_when.model_dump())
    return start


def key_of(release: str, parameter: str) -> str:
    """Key under which an ensemble samples a parameter of one release."""
    return release + OF_RELEASE + parameter


def own_range(key: str) -> Range | None:
    """Range of a sampled start time or speed of a release, by its key; None for other parameters."""
    name, _, parameter = key.partition(OF_RELEASE)
    return RANGES.get(parameter) if name else None


def words_of(key: str) -> str:
    """What a sampled parameter with :func:`own_range` is."""
    name, _, parameter = key.partition(OF_RELEASE)
    return f"{'start time' if parameter == TIME else 'speed at the start'} of release {name}"


def sampled_ranges(releases: Sequence[Any]) -> dict[str, Range]:
    """Range of what an ensemble may sample of the start of releases, by its key, from their settings."""
    times = {key_of(r.name, TIME): RANGES[TIME] for r in releases if r.starts_when is None}
    return times | {key_of(r.name, SPEED): RANGES[SPEED] for r in releases if not isinstance(r.velocity, list)}


def stated_ranges(site: Any) -> dict[str, Range]:
    """The same of a site.yaml as it is stated, for every release."""
    names = [str(release.get("name", "release")) for release in _releases(site)]
    return {key_of(name, parameter): valid for name in names for parameter, valid in RANGES.items()}


def sampled_starts(releases: "Sequence[Release]", sample: Mapping[str, float]) -> "list[Release]":
    """The releases with their sampled start times [s] and speeds [m/s] in the place of those that they state."""
    return [_with_sample(release, sample) for release in releases]


def _with_sample(release: "Release", sample: Mapping[str, float]) -> "Release":
    from runout.model.release_start import StartVelocity

    changes: dict[str, Any] = {}
    if (key := key_of(release.name, TIME)) in sample:
        changes[TIME] = sample[key]
    if (key := key_of(release.name, SPEED)) in sample:
        velocity = release.velocity if isinstance(release.velocity, StartVelocity) else StartVelocity(0.0)
        changes[VELOCITY] = replace(velocity, speed=sample[key])
    return replace(release, **changes) if changes else release


def start_conflicts(site: Any) -> Iterator[tuple[int, str, str, str]]:
    """Starts of a site.yaml that contradict each other or the end: number of the release, key, message and remedy."""
    from runout.model.release_start import Arrival, start_problems

    releases = _releases(site)
    simulation = site.get("simulation") if isinstance(site, dict) else None
    end = simulation.get("end_time") if isinstance(simulation, dict) else None
    starts, names = [], [str(release.get("name", "release")) for release in releases]
    for number, (name, release) in enumerate(zip(names, releases, strict=True)):
        if release.get(TIME) is not None and release.get(TRIGGER) is not None:
            yield number, TRIGGER, f"{TIME} is given too", "remove one of the two"
        trigger = release.get(TRIGGER)
        other = trigger.get("arrives") if isinstance(trigger, dict) else None
        starts.append((name, _number(release.get(TIME), 0.0), Arrival(other) if isinstance(other, str) else None))
    latest = _number(end, math.inf)
    for number, _, key, message, remedy in start_problems(starts, latest):
        yield number, key, message, remedy


def foreign_parameters(site: Any, sampled: Mapping[str, Any]) -> Iterator[tuple[str, str, str]]:
    """Sampled starts that the releases of a site.yaml do not have, or that may lie behind the end: key, message and remedy."""
    releases = {str(release.get("name", "release")): release for release in _releases(site)}
    inflows = [str(one.get("name", "inflow")) for one in _releases(site, "inflow")]
    simulation = site.get("simulation") if isinstance(site, dict) else None
    end = simulation.get("end_time") if isinstance(simulation, dict) else None
    for key in filter(own_range, sampled):
        name, _, parameter = key.partition(OF_RELEASE)
        release = releases.get(name)
        if release is None and name in inflows:
            yield key, f"{name} is an inflow, which starts as its hydrograph states", "remove it, or sample inflow_delay"
        elif release is None:
            choices = [key_of(other, parameter) for other in releases]
            yield key, f"no release is called {name!r}", choice_fix(key, choices) if choices else "remove it"
        elif parameter == TIME and release.get(TRIGGER) is not None:
            yield key, f"release {name} {TRIGGER} the flow of another arrives, not at a time", "remove one of the two"
        elif parameter == SPEED and isinstance(release.get(VELOCITY), list):
            yield key, f"the velocity of release {name} has three components", f"state {VELOCITY}: {{speed, azimuth_deg}}"
        elif parameter == TIME and (latest := _largest(sampled[key])) >= (last := _number(end, math.inf)):
            yield key, f"it can give {latest:g} s; the run ends at {last:g} s", "narrow it, or set simulation.end_time later"


def _releases(site: Any, key: str = "release") -> list[dict[str, Any]]:
    entries = site.get(key) if isinstance(site, dict) else None
    return [r if isinstance(r, dict) else {} for r in entries] if isinstance(entries, list) else []


def _largest(distribution: Any) -> float:
    """Largest number of a distribution as it is stated; minus infinity if it states none."""
    block = distribution if isinstance(distribution, dict) else {}
    values = block.get("values") if isinstance(block.get("values"), list) else [block.get("high")]
    return max((_number(value, -math.inf) for value in values or []), default=-math.inf)


def _number(value: Any, otherwise: float) -> float:
    """A number of site.yaml, or another one where it states none."""
    return float(value) if is_number(value) else otherwise
