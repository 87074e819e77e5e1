"""Commands that show the results of a site, and a member in three dimensions."""

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from runout.commands.options import Device, Injected, SiteArgument, command
from runout.commands.written import Written
from runout.errors import ExitCode

Member = Annotated[
    int | None, Parameter(help="Number of the member, as in `runout status` [default: that of the median run-out in the last run].")
]
Frames = Annotated[int | None, Parameter(help="Number of frames [default: those that are there, or 40].")]
Colour = Annotated[Literal["thickness", "speed"], Parameter(help="What the colours show.")]
Show = Annotated[Literal["surface", "particles"], Parameter(help="Free surface of the flow, or its particles.")]
Image = Annotated[Path | None, Parameter(help="GeoTIFF on the ground, such as an orthophoto [default: hillshade].")]
Direction = Annotated[
    str, Parameter(help="auto, top, north, east, south, west (where the camera stands), or azimuth,elevation in degrees.")
]
Size = Annotated[tuple[int, int], Parameter(consume_multiple=True, negative="", help="Width and height [pixel].")]


@command(writes=False, short=True)
def open(
    site: SiteArgument,
    *,
    qgis: Annotated[bool, Parameter(negative="", help="Open the project of the results in QGIS.")] = False,
    session: Injected,
) -> int:
    """Open the report of a site in the browser; where none can be started, print its path."""
    from runout.workflow.opening import open_results

    open_results(site, session.out, qgis=qgis)
    return ExitCode.OK


@command(writes=False)  # unless it has to simulate
def view(
    site: SiteArgument,
    *,
    member: Member = None,
    frames: Frames = None,
    colour: Colour = "thickness",
    show: Show = "surface",
    camera: Direction = "auto",
    image: Image = None,
    size: Size = (1280, 720),
    device: Device = None,
    session: Injected,
) -> int:
    """Open a window on the flow of one member in 3D, with a slider for the time; needs the extra runout[view]."""
    from runout.workflow.seeing import Choices
    from runout.workflow.seeing import view as open_view

    open_view(site, session.out, Choices(member, frames, colour, show, camera, image, size, device))
    return ExitCode.OK


@command()
def animate(
    site: SiteArgument,
    *,
    member: Member = None,
    frames: Frames = None,
    output: Annotated[
        Path | None,
        Parameter(help="Film .mp4 or .gif, or a folder for PNG [default: animations/ in the results folder]."),
        Written(folder=None, instead=True),
    ] = None,
    vtk: Annotated[
        Path | None, Parameter(help="Folder for files of ParaView with the time of each frame."), Written(folder=True, instead=True)
    ] = None,
    colour: Colour = "thickness",
    show: Show = "surface",
    camera: Direction = "auto",
    image: Image = None,
    size: Size = (1280, 720),
    fps: Annotated[float, Parameter(help="Frames per second of the film.")] = 10.0,
    device: Device = None,
    session: Injected,
) -> int:
    """Write a film of one member in 3D, or files for ParaView; needs no display, but the extra runout[view]."""
    from runout.workflow.seeing import Choices
    from runout.workflow.seeing import animate as write

    write(site, session.out, Choices(member, frames, colour, show, camera, image, size, device), output, vtk, fps)
    return ExitCode.OK
