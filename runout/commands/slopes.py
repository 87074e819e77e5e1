"""Commands on slopes: where a terrain may fail, scarps, and a cheap baseline of the runout."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from runout.commands.options import Injected, SiteArgument, command
from runout.slopes.choices import MassWasting, PatchChoices, ScarpChoices, Strength

PlaceArgument = Annotated[Path, Parameter(help="Folder of the site, its site.yaml, or an elevation raster.")]
_Soil = Annotated[Strength | None, Parameter(name="*", negative_iterable=(), group="Strength of the soil, ranges")]
_Patches = Annotated[PatchChoices | None, Parameter(name="*", negative_iterable=(), group="Releases")]
_Scarp = Annotated[ScarpChoices | None, Parameter(name="*", negative_iterable=(), group="Shape")]
_Automaton = Annotated[MassWasting | None, Parameter(name="*", group="Parameters of MassWastingRunout")]


@command()
def suggest_release(
    site: PlaceArgument,
    *,
    terrain_only: Annotated[
        bool, Parameter(name="--terrain-only", negative="", help="Sinks, flow paths, slope and drainage area only.")
    ] = False,
    strength: _Soil = None,
    releases: _Patches = None,
    session: Injected,
) -> int:
    """Report sinks, flow paths and slope, map the factor of safety, and propose release polygons; needs landlab.

    Writes results/slopes/. `runout new` takes its release.gpkg as it is.
    """
    from runout.slopes.suggestion import command

    return command(site, session.out, terrain_only, strength, releases)


@command()
def scarp(site: PlaceArgument, *, shape: _Scarp = None, session: Injected) -> int:
    """Make a thickness raster that thins out to its rim, above an ellipsoid or planes; writes results/scarp/."""
    from runout.slopes.scarp import command

    return command(site, session.out, shape or ScarpChoices())


@command()
def screen(site: SiteArgument, *, parameters: _Automaton = None, session: Injected) -> int:
    """Run landlab's MassWastingRunout as a cheap baseline and list places to look at in 3D; writes results/screen/."""
    from runout.slopes.screening import command

    return command(site, session.out, parameters or MassWasting())
