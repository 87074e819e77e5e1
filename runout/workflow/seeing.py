"""Shows one member of a site in three dimensions: window, film, files for ParaView."""

import logging
import shutil
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any

import numpy as np

from runout import log
from runout.config.schema import MOST_SNAPSHOTS
from runout.config.site_files import may_hold_bodies
from runout.errors import ConfigError, RenderError
from runout.io.draped_image import draped_image
from runout.io.member_maps import MemberMaps
from runout.view import film, process
from runout.view.camera import stated_direction
from runout.view.film import flow_scene, held
from runout.view.scene import FlowScene, Mesh, Span, on_structures
from runout.view.surfaces import COLOURED
from runout.workflow.opening import has_display
from runout.workflow.single_member import chosen_member, simulation_file
from runout.workflow.study import Study

if TYPE_CHECKING:
    from runout.config.site import Site
    from runout.ensemble.member import Member

LOGGER = logging.getLogger("runout.seeing")
FRAMES, PARTICLES = 40, 20_000  # of a simulation that is made for the pictures
SMALLEST, LARGEST = 64, 7680  # [pixel]
SHOWN = ("surface", "particles")
NO_DISPLAY = "there is no display for a window; `runout animate {site}` makes a film without one"


@dataclass(frozen=True)
class Choices:
    """What is shown, and how.

    Attributes
    ----------
    member : int or None
        Number of the member; None: the representative one of the last run (:func:`representative_member`).
    frames : int or None
        Number of frames; None: those that are there, or :data:`FRAMES`.
    colour, show, camera : str
        "thickness" or "speed"; "surface" or "particles"; see :func:`runout.view.camera.stated_direction`.
    image : Path or None
        GeoTIFF on the ground instead of the hillshade.
    size : tuple of int
        Width and height [pixel].
    device : str or None
        Device of a simulation that has to be made first; it replaces that of site.yaml.
    """

    member: int | None = None
    frames: int | None = None
    colour: str = "thickness"
    show: str = "surface"
    camera: str = "auto"
    image: Path | None = None
    size: tuple[int, int] = (1280, 720)
    device: str | None = None

    def __post_init__(self) -> None:
        if self.frames is not None and not 1 <= self.frames <= MOST_SNAPSHOTS:
            raise ConfigError(f"frames is {self.frames}; it must be 1 to {MOST_SNAPSHOTS}")
        for name, known in (("colour", COLOURED), ("show", SHOWN)):
            if getattr(self, name) not in known:
                raise ConfigError(f"{name} is {getattr(self, name)!r}; choose one of {', '.join(known)}")
        if not all(SMALLEST <= side <= LARGEST for side in self.size):
            raise ConfigError(f"size is {self.size[0]} x {self.size[1]}; each side must be {SMALLEST} to {LARGEST} pixels")
        stated_direction(self.camera)

    @property
    def look(self) -> dict[str, Any]:
        """Arguments of :class:`runout.view.renderer.Look`."""
        return {"colour": self.colour, "show": self.show, "direction": stated_direction(self.camera), "size": self.size}


def view(site_path: Path, out: Path | None, choices: Choices) -> None:
    """Open a window; returns when it is closed.

    Raises RenderError if there is no display, no pyvista or no OpenGL.
    """
    if not has_display():
        raise RenderError(NO_DISPLAY.format(site=quote(str(site_path))))
    process.require_packages()
    scene = scene_of(site_path, out, of_last_run(site_path, out, choices))
    with process.folder_for_job() as folder:
        process.make("window", scene, choices.look, folder)


def animate(site_path: Path, out: Path | None, choices: Choices, output: Path | None, vtk: Path | None, fps: float) -> list[Path]:
    """Write a film, files for ParaView, or both; returns their paths. The film is left out if only ``vtk`` is stated.

    Raises ConfigError, RenderError or StorageError if a choice is not valid, there is no pyvista, OpenGL or codec, or a file
    cannot be written.
    """
    process.require_packages()
    if not 0 < fps <= 120:
        raise ConfigError(f"fps is {fps:g}; it must be above 0 and at most 120")
    choices = of_last_run(site_path, out, choices)
    if output is None and vtk is None:
        output = _usual_output(Study.open(site_path, out).results, choices)
    if output is not None:
        film.kind_of(output)
    scene, made = scene_of(site_path, out, choices), []
    with process.folder_for_job() as folder:
        if vtk is not None:
            made.append(_write_files(scene, choices, folder / "files", vtk))
        if output is not None:
            made.append(_write_film(scene, choices, folder / "film", output, fps))
    for path in made:
        LOGGER.info("wrote %s: %d frames, %.4g to %.4g s", path, len(scene.times), scene.times[0], scene.times[-1])
    return made


def of_last_run(site_path: Path, out: Path | None, choices: Choices) -> Choices:
    """The choices with the representative member of the last run, unless they name a member."""
    return choices if choices.member is not None else replace(choices, member=representative_member(Study.open(site_path, out)))


def representative_member(study: Study) -> int:
    """Number of the finished member with the median run-out, as in the report; 0 if no member has run."""
    from runout.hazard.reach import representative_of
    from runout.workflow.sensitivity import reach_of

    done = {standing.member.number: standing.member for standing in study.standings if standing.state == "done"}
    if not done:
        LOGGER.info("no member has run with these settings: member 0 is shown")
        return 0
    maps = _opened({number: member.file(study.results) for number, member in done.items()})
    least = min(study.site.settings.hazard.thickness_thresholds)
    number = representative_of(maps, study.members["weight"], reach_of(study.site), least)
    LOGGER.info("member %d has the median run-out of %d members", number, len(done))
    return number


def _opened(paths: "Mapping[int, Path]") -> "Iterator[tuple[int, MemberMaps]]":
    """Maps of members by number, one open file at a time."""
    for number, path in paths.items():
        with MemberMaps(path) as maps:
            yield number, maps


def scene_of(site_path: Path, out: Path | None, choices: Choices) -> FlowScene:
    """Scene of a member; its simulation is made if there is none with enough frames."""
    study = Study.open(site_path, out, device=choices.device)
    site, member = study.site, chosen_member(study.site, choices.member or 0)
    terrain = site.terrain()
    if choices.image is not None:
        draped_image(choices.image, terrain.extent, terrain.crs, most=64)  # refused before a simulation
    file = simulation(study, member, choices)
    releases = site.releases(sample=member.parameters)
    title = f"{site.settings.title or site.name}, member {member.number}"
    least = site.settings.simulation.arrival_threshold
    shown: dict[str, Any] = {"count": choices.frames, "title": title, "least_thickness": least, "meshes": structure_meshes(site)}
    scene = flow_scene(file, terrain, releases, **shown)
    if may_hold_bodies(site.settings):
        scene = on_structures(scene, structure_spans(site, scene))
    if choices.image is not None:
        scene = replace(scene, image=draped_image(choices.image, scene.extent, scene.crs))
    return scene


def simulation(study: Study, member: "Member", choices: Choices) -> Path:
    """File with the frames of a member: of `runout simulate`, of the ensemble if it keeps snapshots, or a new simulation."""
    from runout.ensemble.member import stored_key
    from runout.workflow import single_member

    wanted = choices.frames or 1
    # particles say whether a flow is on a roof or below it
    drawn = choices.show == "particles" or may_hold_bodies(study.site.settings)
    own = simulation_file(study.results, member.number)
    for file in (own, member.file(study.results)):
        found = held(file)
        planned = found.planned if file == own else study.site.settings.simulation.snapshots or 0
        if found.frames and planned >= wanted and found.particles >= drawn and stored_key(file) == member.key:
            return file
    why = "there is no simulation with snapshots" if not held(own).frames else "its simulation is of other settings or has too few"
    frames = max(choices.frames or 0, FRAMES, held(own).planned)  # few ones would end long before the flow does
    LOGGER.info("member %d: %s; simulating it with %d snapshots, apart from the ensemble", member.number, why, frames)
    most = PARTICLES if drawn else 0
    return single_member.run(
        study.site.file, study.results, member=member.number, snapshots=frames, particles=most, device=choices.device
    )


def structure_meshes(site: "Site") -> Mapping[str, Mesh]:
    """Structures of a site by name, in map coordinates."""
    if not may_hold_bodies(site.settings):
        return {}
    terrain = site.terrain()
    return {solid.name: (terrain.frame.to_map(solid.vertices), solid.faces) for solid in site.files.bodies().solids}


def structure_spans(site: "Site", scene: FlowScene) -> list[Span]:
    """Lowest and highest elevation of each structure at the cells of a scene, and whether it hangs."""
    from runout.structures.inspection import vertical_span

    terrain, found = site.terrain(), []
    easting, northing = np.meshgrid(scene.easting, scene.northing)
    places = terrain.frame.to_local(np.stack([easting, northing], axis=-1).reshape(-1, 2))
    for solid in site.files.bodies().solids:
        over = ((places >= solid.box[0, :2]) & (places <= solid.box[1, :2])).all(axis=1)
        span = np.full((2, len(places)), np.nan)
        span[:, over] = vertical_span(solid, places[over]).T
        span[~np.isfinite(span)] = np.nan
        low, high = span.reshape(2, *scene.ground.shape)
        found.append((low, high, solid.clearance is not None))
    return found


def _usual_output(results: Path, choices: Choices) -> Path:
    """A film in the results folder: MP4, or GIF where there is no codec."""
    name = f"{choices.member or 0:04d}_{choices.colour}" + ("_particles" if choices.show == "particles" else "")
    kind = ".mp4" if film.has_codec() else ".gif"
    if kind == ".gif":
        LOGGER.warning("%s; a GIF is made instead", film.NO_CODEC.split(";")[0])
    return results / "animations" / f"{name}{kind}"


def _write_film(scene: FlowScene, choices: Choices, folder: Path, output: Path, fps: float) -> Path:
    folder.mkdir()
    with log.progress("drawing") as bar:
        made = process.make("frames", scene, choices.look, folder, bar)
    frames = [path for path in made if path.suffix == ".png"]
    return film.write_film(frames, list(scene.times), output, fps)


def _write_files(scene: FlowScene, choices: Choices, folder: Path, target: Path) -> Path:
    """Files for ParaView in the folder ``target``; older ones of these names are replaced."""
    from runout.io.atomic import storage_error

    folder.mkdir()
    made = process.make("files", scene, choices.look, folder)
    try:
        target.mkdir(parents=True, exist_ok=True)
        for path in sorted(made, key=lambda path: path.suffix == ".pvd"):  # collections last: they name the other files
            shutil.copyfile(path, target / path.name)
    except OSError as cause:
        raise storage_error(target, cause) from cause
    return target
