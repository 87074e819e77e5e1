"""Schemes of danger classes: intensity in a cell, return periods, and the matrix of both; ``runout/schemes/*.yaml``.

A class has criteria, of which any suffices; a criterion has thresholds that the flow reaches together. A cell has the strongest
class that it reaches at a rate of 1/T or more, for each return period T. Each value states how its source was checked.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations, pairwise
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, ValidationError, create_model, model_validator

from runout.config.distributions import Settings, quantity, refuse
from runout.config.document import Document, Location, read_document
from runout.config.hazard import limit, require_numbers, rising
from runout.config.problems import problems_of
from runout.config.quantities import Text
from runout.config.wording import choice_fix, shown
from runout.errors import ConfigError, Problem
from runout.model.joint_conditions import HOUSE, Key, flow_part, is_bounded
from runout.quantities import ALL_QUANTITIES, BED_QUANTITIES
from runout.variables import VARIABLES

FOLDER = Path(__file__).parents[1] / "schemes"
CHECKED = {"primary": "read in the source", "secondary": "from a secondary source", "memory": "from memory, not verified"}
_WORDS = {"1": "", "m s-1": "m/s", "m2 s-1": "m2/s", "m3 s-2": "m3/s2"}  # units for people
MOST_CLASSES = 20  # of intensity, or levels of danger

Checked = Literal["primary", "secondary", "memory"]
Colour = Annotated[str, Field(pattern=r"^#[0-9a-fA-F]{6}$")]
Years = Annotated[list[Annotated[float, Field(ge=1, le=1e6)]], Field(min_length=1, max_length=MOST_CLASSES), AfterValidator(rising)]


def checked() -> Any:
    """The field of how a value was checked."""
    return quantity("how the value was checked: primary, secondary (source) or memory")


class Source(Settings):
    """Where a scheme is published."""

    title: Text = quantity("title of the publication")
    edition: Text = quantity("edition, and what of it was read")
    address: Text = quantity("address of the publication")


class HouseStrength(Settings):
    """Strength of a house against the flow, F / (H (h - H)) [Pa], at a thickness H [m]; least at h / 2, which holds above it."""

    force: float = quantity("F", gt=0, unit="N")
    height: float = quantity("h", gt=0, unit="m")


class _Criterion(Settings):
    """Thresholds that the flow reaches together."""

    reached: Literal[True] | None = quantity("wherever the flow arrives", None, hint="write true")
    house_strength: HouseStrength | None = quantity("pressure that exceeds the strength of a house", None)

    @model_validator(mode="after")
    def _one_kind(self) -> "_Criterion":
        require_numbers(self)
        keys = list(self.model_dump(exclude_none=True))
        if not keys:
            raise refuse("a criterion without thresholds", f"write reached: true, or thresholds of {', '.join(ALL_QUANTITIES)}")
        if len(keys) > 1 and (self.reached or self.house_strength):
            raise refuse(f"{keys[0]} stands alone in a criterion", "write the others as criteria of their own")
        return self

    @property
    def thresholds(self) -> dict[str, float]:
        """Thresholds by the name of the quantity."""
        return self.model_dump(exclude_none=True, exclude={"reached", "house_strength"})

    @property
    def condition(self) -> dict[str, float]:
        """What members record at one time (:mod:`runout.model.joint_conditions`): thresholds, or the strength of a house."""
        strength = self.house_strength
        return dict(zip(HOUSE, (strength.force, strength.height), strict=True)) if strength else self.thresholds

    def within(self, other: "_Criterion") -> bool:
        """Whether whatever meets this criterion meets the other one too."""
        if other.reached:
            return self.reached is True
        if other.house_strength or self.house_strength:
            return self.house_strength == other.house_strength
        own = self.thresholds
        return all(name in own and own[name] >= least for name, least in other.thresholds.items())

    def __str__(self) -> str:
        if self.reached:
            return "reached"
        if self.house_strength:
            strength = f"{self.house_strength.force / 1e3:g} / (H ({self.house_strength.height:g} - H)) kPa"
            return f"pressure of {strength} or more at a thickness H in m at one time"
        thresholds, flow = self.thresholds, flow_part(self.thresholds)
        parts = [f"{ALL_QUANTITIES[name].words} of {_printed(name, least)} or more" for name, least in (flow | thresholds).items()]
        parts[len(flow) - 1] += " at one time" if flow else ""
        return " and ".join(parts)


def _compared(criterion: "_Criterion") -> str:
    """How a criterion is compared whose thresholds members do not record at one time."""
    used = "maxima of different times are compared"
    if criterion.house_strength:
        used = "the largest pressure is compared with the strength at the largest thickness"
    elif {"thickness", "speed"} <= criterion.thresholds.keys():
        used = "thickness and speed are bounded by the maxima of both, of the smaller of both, and of their products"
    return f"members ran without this criterion and do not record it, so that {used}"


def _printed(name: str, least: float) -> str:
    units, divisor = VARIABLES[ALL_QUANTITIES[name].threshold].printed
    return f"{least / divisor:g} {_WORDS.get(units, units)}".rstrip()


_THRESHOLDS: Any = {
    name: (limit(q) | None, quantity(f"at least this {q.extreme}", None, unit=q.units, hint=q.hint))
    for name, q in ALL_QUANTITIES.items()
}
Criterion: Any = create_model("Criterion", __base__=_Criterion, **_THRESHOLDS)


class IntensityClass(Settings):
    """A class of intensity."""

    name: Text = quantity("name of the class")
    when: Annotated[list[Criterion], Field(min_length=1, max_length=MOST_CLASSES)] = quantity("criteria, of which any suffices")
    checked: Checked = checked()
    note: Text | None = quantity("what a reader has to know of the class", None)


class ReturnPeriods(Settings):
    """Return periods of a scheme."""

    years: Years = quantity("return periods, the shortest first", unit="a")
    checked: Checked = checked()


def _falling(values: list[float]) -> list[float]:
    rising([-value for value in values])
    return values


class Risk(Settings):
    """Individual risk: annual rate of being reached, times presence, times vulnerability."""

    annual: Annotated[list[Annotated[float, Field(gt=0, lt=1)]], Field(min_length=1), AfterValidator(_falling)] = quantity(
        "levels of the individual risk, the largest first", unit="1/a"
    )
    presence: Annotated[float, Field(gt=0, le=1)] | None = quantity("share of time that the person most at risk is there", None)
    vulnerability: Annotated[float, Field(gt=0, le=1)] | None = quantity("probability that they die if the flow arrives", None)
    checked: Checked = checked()


class Level(Settings):
    """A level of danger."""

    name: Text = quantity("name of the level")
    colour: Colour = quantity("colour", hint='write it as "#d7191c"')
    consequence: Text = quantity("one sentence on the consequence")
    checked: Checked = checked()


class Matrix(Settings):
    """Level of danger by class of intensity and return period."""

    rows: dict[str, list[str]] = quantity("for each class a list of levels, one for each return period")
    checked: Checked = checked()


class DangerScheme(Settings):
    """A scheme of danger classes."""

    title: Text = quantity("name of the scheme")
    process: Text = quantity("process that it is for")
    source: Source = quantity("publication")
    classes: Annotated[list[IntensityClass], Field(min_length=1, max_length=MOST_CLASSES)] = quantity("classes, the weakest first")
    return_periods: ReturnPeriods | None = quantity("return periods; or risk", None)
    risk: Risk | None = quantity("levels of individual risk, in the place of return periods", None)
    levels: Annotated[list[Level], Field(max_length=MOST_CLASSES)] = quantity("levels of danger, the lowest first", [])
    matrix: Matrix | None = quantity("level by class and return period; without it there are classes only", None)
    beyond: Text | None = quantity("level of cells that are reached more rarely than at the longest return period", None)
    does_not_say: Annotated[list[Text], Field(min_length=1)] = quantity("sentences on what the scheme does not say")

    @property
    def years(self) -> list[float]:
        """Return periods [a]; of individual risk those at which the risk of being reached equals its levels."""
        if self.return_periods:
            return self.return_periods.years
        risk = self.risk
        assert risk is not None
        return [(risk.presence or 1.0) * (risk.vulnerability or 1.0) / annual for annual in risk.annual]

    @property
    def states(self) -> list[str]:
        """How its values were checked, each state once."""
        parts: list[Any] = [*self.classes, *self.levels, *filter(None, (self.return_periods, self.risk, self.matrix))]
        return [state for state in CHECKED if state in {part.checked for part in parts}]

    @property
    def conditions(self) -> list[dict[str, float]]:
        """Conditions of the criteria of several thresholds, and of those of the strength of a house."""
        return [criterion.condition for one in self.classes for criterion in one.when if len(criterion.condition) > 1]

    def remarks(self, has_bed: bool, places: Mapping[Key, int]) -> list[str]:
        """Sentences on how criteria were compared, where that is not as the scheme asks for.

        ``places`` are those of the conditions that members record at one time.
        """
        criteria = [(one.name, criterion) for one in self.classes for criterion in one.when]
        texts = [
            f"Class {name} ({criterion}): {_compared(criterion)}; its area is too large rather than too small."
            for name, criterion in criteria
            if is_bounded(criterion.condition, places)
        ]
        of_bed = sorted({name for _, criterion in criteria for name in criterion.thresholds if name in BED_QUANTITIES})
        if of_bed and not has_bed:
            words = " and ".join(BED_QUANTITIES[name].words for name in of_bed)
            texts.append(f"The site has no erodible bed: {words} counts as 0.")
        return texts


def names() -> list[str]:
    """Names of the schemes of runout."""
    return sorted(path.stem for path in FOLDER.glob("*.yaml"))


def is_file(name: Any) -> bool:
    """Whether a scheme is stated as a file, and not by the name of one of runout."""
    return not isinstance(name, str) or name.endswith((".yaml", ".yml"))


def path_of(name: str, folder: Path = FOLDER) -> Path:
    """File of a scheme: one of runout by its name, or one whose path is relative to a folder."""
    return folder / name if is_file(name) else FOLDER / f"{name}.yaml"


def read_scheme(name: str, folder: Path = FOLDER) -> DangerScheme:
    """The scheme of a name or of a file, whose path is relative to ``folder``.

    Raises
    ------
    ConfigError
        With all problems of the file.
    """
    path = path_of(name, folder)
    if not is_file(name) and name not in names():
        raise ConfigError([Problem("site.yaml", None, "hazard.scheme", *unknown(name))])
    if not path.is_file():
        raise ConfigError(f"{path}: there is no such scheme")
    document = read_document(path)
    scheme, problems = None, list(document.problems)
    if not problems and not isinstance(document.values, Mapping):
        problems.append(Problem(path.name, 1, "", f"{shown(document.values)}; a block of `key: value` lines is needed"))
    elif not problems:
        try:
            scheme = DangerScheme.model_validate(document.values)
            problems += [document.problem(*contradiction) for contradiction in _contradictions(scheme)]
        except ValidationError as error:
            problems += problems_of(error, document, DangerScheme)
    if problems or scheme is None:
        raise ConfigError(problems)
    return scheme


def unknown(name: str) -> tuple[str, str]:
    """Message and remedy for a name that no scheme of runout has."""
    fix = choice_fix(name, names())
    return f"{name!r} is no scheme of runout", f"{fix}, or name a file that ends with .yaml"


def site_problems(document: Document, folder: Path) -> Iterator[Problem]:
    """Problems of the scheme that a site.yaml names: of its name, of its file, and what it needs of the site."""
    place: Location = ("hazard", "scheme")
    name = document.value(place)
    if not isinstance(name, str) or (is_file(name) and not path_of(name, folder).is_file()):
        return
    if not is_file(name) and name not in names():
        yield document.problem(place, *unknown(name))
        return
    if not any(document.value(("ensemble", key)) for key in ("scenarios", "table")):
        message = "levels of danger need annual rates, and the fraction of an ensemble is not an annual probability"
        yield document.problem(place, message, "state ensemble.scenarios with return_period or annual_rate, or remove the scheme")
    try:
        scheme = read_scheme(name, folder)
    except ConfigError as error:
        yield from error.problems
        return
    yield from _unmet(document, place, name, scheme)


def _unmet(document: Document, place: Location, name: str, scheme: DangerScheme) -> Iterator[Problem]:
    """What a scheme needs that nobody states."""
    missing = [key for key in ("presence", "vulnerability") if scheme.risk and getattr(scheme.risk, key) is None]
    if missing:
        fix = f"copy the scheme (`runout schemes {name} > mine.yaml`) and state {' and '.join(f'risk.{key}' for key in missing)}"
        message = f"{scheme.title}: runout does not know {' and '.join(missing)} of the person most at risk"
        yield document.problem(place, message, f"state risk.{missing[0]} in it" if is_file(name) else fix)
    if not document.value(("bed",)):
        for one in scheme.classes:
            if all(criterion.thresholds.keys() & BED_QUANTITIES.keys() for criterion in one.when):
                message = f"class {one.name} needs an erodible bed, which the site does not have"
                yield document.problem(place, message, "add bed: {depth: ..., erosion: {...}}, or choose another scheme")


def _contradictions(scheme: DangerScheme) -> Iterator[tuple[Location, str, str]]:
    """Settings that contradict each other: location, message, remedy."""
    named: dict[str, Any] = {"classes": scheme.classes, "levels": scheme.levels}
    for key, entries in named.items():
        for (_, first), (k, other) in combinations(enumerate(entries), 2):
            if first.name == other.name:
                yield (key, k, "name"), f"the name {other.name!r} stands twice in {key}", "give each its own name"
    for (_, weaker), (k, stronger) in combinations(enumerate(scheme.classes), 2):
        for a, b in ((a, b) for a in weaker.when for b in stronger.when if a.within(b)):
            message = f"the classes overlap: {weaker.name!r} with {a} lies within {stronger.name!r} with {b}"
            yield ("classes", k, "when"), message, "list the weakest class first, and raise the threshold of the stronger class"
    if bool(scheme.return_periods) == bool(scheme.risk):
        key = "risk" if scheme.risk else "return_periods"
        yield (key,), "a scheme has either return_periods or risk", "state one of the two"
        return
    yield from _of_matrix(scheme, len(scheme.return_periods.years if scheme.return_periods else scheme.risk.annual))  # type: ignore[union-attr]


def _of_matrix(scheme: DangerScheme, periods: int) -> Iterator[tuple[Location, str, str]]:
    """Missing, surplus and unknown cells of the matrix."""
    levels = [level.name for level in scheme.levels]
    if scheme.beyond and scheme.beyond not in levels:
        yield ("beyond",), f"{scheme.beyond!r} is none of the levels", choice_fix(scheme.beyond, levels)
    if bool(scheme.matrix) != bool(levels):
        yield ("matrix" if scheme.matrix else "levels",), "levels and matrix need each other", "state both or none"
        return
    rows = scheme.matrix.rows if scheme.matrix else {}
    for one in scheme.classes if scheme.matrix else ():
        if one.name not in rows:
            yield ("matrix", "rows"), f"class {one.name!r} has no row", f"add {one.name}: with {periods} levels"
    for name, row in rows.items():
        place: Location = ("matrix", "rows", name)
        if name not in [one.name for one in scheme.classes]:
            yield place, f"{name!r} is none of the classes", choice_fix(name, [one.name for one in scheme.classes])
        if len(row) != periods:
            yield place, f"{len(row)} levels for {periods} return periods", "state one level for each, the shortest period first"
        for k, level in enumerate(row):
            if level not in levels:
                yield (*place, k), f"{level!r} is none of the levels", choice_fix(level, levels)
    if all(level in levels for row in rows.values() for level in row):
        yield from _of_order(scheme, rows, levels)


def _of_order(scheme: DangerScheme, rows: Mapping[str, list[str]], levels: Sequence[str]) -> Iterator[tuple[Location, str, str]]:
    """Cells of the matrix with more danger from rarer events, or less danger from a stronger class."""
    weaker: list[int] = []
    for one in scheme.classes:
        row = [levels.index(level) for level in rows.get(one.name, ())]
        place: Location = ("matrix", "rows", one.name)
        after = [*row, levels.index(scheme.beyond)] if scheme.beyond in levels and row else row
        if any(b > a for a, b in pairwise(after)):
            yield place, "rarer events have a higher level than more frequent ones", "list the shortest return period first"
        if any(b < a for a, b in zip(weaker, row, strict=False)):
            message = f"class {one.name!r} has a lower level than a weaker class"
            yield place, message, "list levels from the lowest and classes from the weakest, and check the row"
        weaker = row
