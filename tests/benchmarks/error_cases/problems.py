"""The problems of error against time: U7, U9, T1, T5, F3, F5 and flows on real terrain, each on successively finer grids."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from tests.benchmarks.error_cases import flows, solids
from tests.benchmarks.error_cases.choice import FEW, VARIATIONS, Outcome, Variation, selectable
from tests.benchmarks.error_cases.terrains import FINE_SITE, SITE

Measure = Callable[[Any, Variation], Outcome]
FINEST, FINER, FINEST_SMALL = ("high", 0.5), ("high", 1.0), ("screening", 1.5)  # reference on terrain: preset, factor of its cells


@dataclass(frozen=True)
class Problem:
    """A problem and its grids.

    Attributes
    ----------
    name, title, error : str
        ``error``: quantity and norm of the error.
    length : float
        Reference length [m], divided by the numbers of the grids; 0 if they are cell sizes [m].
    small, full : tuple
        Grids, the coarsest first: cells along the length, or sizes of cells [m].
    measure : callable
        Outcome on one grid with one variation.
    remark : str
    site : str
        Of a flow on real terrain, one of :data:`tests.benchmarks.error_cases.terrains.FLOWS`.
    quick : callable, optional
        ``measure`` of the small study, where it differs.
    choices : tuple of str
        Names of the variations that are measured; all of them when empty.
    """

    name: str
    title: str
    error: str
    length: float
    small: tuple[float, ...]
    full: tuple[float, ...]
    measure: Measure
    remark: str = ""
    site: str = ""
    quick: Measure | None = None
    choices: tuple[str, ...] = ()

    def cell(self, grid: float) -> float:
        """Size of a cell [m]."""
        return self.length / grid if self.length else grid

    def variations(self) -> list[Variation]:
        """Variations that this version of runout measures on this problem."""
        known = [v for v in VARIATIONS if selectable(v) and (not v.only_on or self.name in v.only_on)]
        return [v for v in known if not self.choices or v.name in self.choices]


@dataclass(frozen=True)
class OnTerrain:
    """Measure of :func:`flows.terrain` against a reference."""

    reference: flows.Reference
    site: str = SITE

    def __call__(self, cell: float, variation: Variation) -> Outcome:
        return flows.terrain(cell, variation, self.reference, self.site)


PROBLEMS: dict[str, Problem] = {
    p.name.lower(): p
    for p in (
        Problem(
            name="U7",
            title="manufactured waves, amplitude 0.05",
            error="largest RMS of displacement over its amplitude",
            length=1.0,
            small=(8, 16),
            full=(8, 16, 32, 64),
            measure=solids.waves,
            remark="Reference backend in float64, the only one that takes a body force.",
        ),
        Problem(
            name="U9",
            title="column under its weight",
            error="mean error of stress over the weight",
            length=solids.LENGTH,
            small=(8, 16),
            full=(8, 16, 32, 64),
            measure=solids.column,
            remark="8 to 192 particles: time is that of a step without work.",
        ),
        Problem(
            name="T1",
            title="settled box on a plane of 20 degrees",
            error="way after 1 s",
            length=solids.sliding_box.SIZE[2],
            small=(3, 4),
            full=(3, 4, 6),
            measure=solids.box,
            remark="Time without the settling.",
        ),
        Problem(
            name="T5",
            title="block in a bowl with friction",
            error="angle at which it turns",
            length=solids.curved_ground.HEIGHT,
            small=(2, 3),
            full=(2, 3, 4, 6),
            measure=solids.bowl,
        ),
        Problem(
            name="F3",
            title="spreading cap, a strip",
            error="thickness after 5 s, relative L2",
            length=flows.spreading_cap.HEIGHT,
            small=(2, 2.83),
            full=(2, 2.83, 4, 5.66, 8),
            measure=flows.strip,
            remark="A slice of four cells with one particle each across.",
        ),
        Problem(
            name="F5",
            title="collapse of aluminium rods",
            error="surface, RMS against the experiment over the first height",
            length=flows.column_collapse.HEIGHT,
            small=(5, 7),
            full=(5, 7, 10, 14),
            measure=flows.rods,
            remark="Against an experiment: the model has a floor of its own, so that this problem cannot rank fine grids.",
        ),
        Problem(
            name="terrain",
            title="jacksboro, 60 s",
            error="map of flow thickness, relative L1",
            length=0.0,
            small=(80.0, 56.6),
            full=(56.6, 40.0, 28.3, 20.0),
            measure=OnTerrain(FINEST),
            remark="Against the preset high with cells half as wide: what is common to that run and another one does not "
            "show. Whole simulations with observers; the DEM has cells of 83 m.",
            site=SITE,
            quick=OnTerrain(FINEST_SMALL),
        ),
        Problem(
            name="fine_terrain",
            title="frank_slide, 60 s",
            error="map of flow thickness, relative L1",
            length=0.0,
            small=(113.0, 80.0),
            full=(56.6, 40.0, 28.3),
            measure=OnTerrain(FINEST, FINE_SITE),
            remark="As before; the DEM has cells of 20 m, finer than those of the runs.",
            site=FINE_SITE,
            quick=OnTerrain(FINEST_SMALL, FINE_SITE),
        ),
        Problem(
            name="terrain_25",
            title="jacksboro near equilibrium (25 degrees), 60 s",
            error="map of flow thickness, relative L1",
            length=0.0,
            small=(80.0,),
            full=(56.6, 40.0, 28.3),
            measure=OnTerrain(FINER, "jacksboro_25"),
            remark="Against the preset high. The weight decides the stiffness.",
            site="jacksboro_25",
            quick=OnTerrain(FINEST_SMALL, "jacksboro_25"),
            choices=FEW,
        ),
        Problem(
            name="fine_terrain_20",
            title="frank_slide with 20 degrees, 60 s",
            error="map of flow thickness, relative L1",
            length=0.0,
            small=(113.0,),
            full=(80.0, 56.6, 40.0),
            measure=OnTerrain(FINER, "frank_slide_20"),
            remark="As before.",
            site="frank_slide_20",
            quick=OnTerrain(FINEST_SMALL, "frank_slide_20"),
            choices=FEW,
        ),
        Problem(
            name="coulomb_only",
            title="ISeeSnow CoulombOnly, 60 s",
            error="map of flow thickness, relative L1",
            length=0.0,
            small=(40.0,),
            full=(14.1, 10.0, 7.07),
            measure=OnTerrain(3.54, "coulomb_only"),
            remark="1.5 m of snow; against cells half as wide as the finest.",
            site="coulomb_only",
            quick=OnTerrain(28.3, "coulomb_only"),
            choices=FEW,
        ),
    )
}
