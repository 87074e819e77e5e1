"""Frames of a member, from the site and the file of its simulation, and films of them: MP4, GIF, or a folder of PNG."""

import logging
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from runout.errors import ConfigError, RenderError
from runout.io.atomic import whole_file, write_text
from runout.report.maps import Basemap
from runout.view.scene import LEAST_SHOWN, FlowScene, Mesh, block_means, block_of, chosen_frames

if TYPE_CHECKING:
    import xarray as xr

    from runout.model.release import Release
    from runout.model.terrain import Terrain

LOGGER = logging.getLogger("runout.view")
MARGIN = 0.5  # of the size of the flow, around it
SNAPSHOTS, PARTICLES = "snapshots", "snapshot_particles"  # groups of a file
Window = tuple[slice, slice]
CODEC, QUALITY = "libx264", 7  # of 10
KINDS = (".mp4", ".gif", "")
NO_CODEC = "MP4 needs imageio-ffmpeg: pip install 'runout[view]'; GIF (--output film.gif) and PNG (--output folder) need nothing"
TIMES = "times.csv"


@dataclass(frozen=True)
class Held:
    """Frames that a file of a simulation holds."""

    frames: int = 0  # number of snapshots
    planned: int = 0  # number of snapshots that were asked for; fewer are there if the run ended early
    particles: bool = False  # whether they have particles


def held(path: Path) -> Held:
    """Frames of a file; none if there is no such file or it is not NetCDF."""
    import netCDF4

    from runout.io.netcdf import LOCK

    try:
        with LOCK, netCDF4.Dataset(path) as file:
            if SNAPSHOTS not in file.groups:
                return Held()
            frames = len(file.groups[SNAPSHOTS].dimensions["time"])
            planned = int(file.getncattr("snapshots_planned")) if "snapshots_planned" in file.ncattrs() else frames
            return Held(frames, max(frames, planned), PARTICLES in file.groups)
    except (OSError, KeyError, RuntimeError):
        return Held()


def flow_scene(
    path: Path, terrain: "Terrain", releases: "Sequence[Release]", *, count: int | None = None, title: str = "",
    least_thickness: float = LEAST_SHOWN, meshes: Mapping[str, Mesh] | None = None,
) -> FlowScene:  # fmt: skip
    """Scene of ``count`` frames, by default all, in a file of :meth:`runout.Result.to_netcdf`; large windows are coarsened.

    Raises StorageError if the file cannot be read.
    """
    import xarray as xr

    from runout.io import netcdf

    choices: Any = {"group": SNAPSHOTS, "engine": "netcdf4", "decode_timedelta": False}
    with netcdf.reading(path, "snapshots "), xr.open_dataset(path, **choices) as shown:
        place = _place(terrain, shown)
        reached = np.zeros(terrain.shape, bool)
        for frame in range(shown.sizes["time"]):  # one at a time: maps may be large
            reached[place] |= np.nan_to_num(shown["flow_thickness"][frame].values) >= least_thickness
        window = window_around(terrain, releases, reached)
        scene = ground_scene(terrain, releases, window, title=title, least_thickness=least_thickness, meshes=meshes)
        chosen, block = chosen_frames(shown.sizes["time"], count), block_of(scene.ground.size)
        thickness, speed = (
            np.stack([block_means(_frame(shown[name][frame], place, window), block) for frame in chosen])
            for name in ("flow_thickness", "speed")
        )
        times = np.asarray(shown["time"].values, float)[chosen]
    if block > 1:
        LOGGER.info("the window has %d cells; means over blocks of %d x %d cells are drawn", scene.ground.size, block, block)
    particles = _particles(path)
    chosen_particles = None if particles is None else particles[chosen]
    return replace(scene.coarsened(), times=times, thickness=thickness, speed=speed, particles=chosen_particles)


def maximum_scene(
    path: Path, terrain: "Terrain", releases: "Sequence[Release]", *, title: str = "", least_thickness: float = LEAST_SHOWN,
    meshes: Mapping[str, Mesh] | None = None,
) -> FlowScene:  # fmt: skip
    """Scene of one frame: the maxima of thickness and speed in the file of a member or simulation."""
    from runout.io.member_maps import MemberMaps

    with MemberMaps(path) as member:
        whole = slice(0, member.shape[0]), slice(0, member.shape[1])
        reached = np.nan_to_num(member.within("max_flow_thickness", whole)) >= least_thickness
        window = window_around(terrain, releases, reached)
        maps = {name: member.within(f"max_{name}", window)[None] for name in ("flow_thickness", "speed")}
    scene = ground_scene(terrain, releases, window, title=title, least_thickness=least_thickness, meshes=meshes)
    return replace(scene, times=np.zeros(1), thickness=maps["flow_thickness"], speed=maps["speed"])


def ground_scene(
    terrain: "Terrain", releases: "Sequence[Release]", window: Window, *, title: str, least_thickness: float,
    meshes: Mapping[str, Mesh] | None,
) -> FlowScene:  # fmt: skip
    """Scene without frames: the ground below the releases, and their outlines."""
    ground = terrain.elevation - np.sum([release.excavation for release in releases], axis=0)
    none = np.zeros((0, *ground[window].shape), np.float32)
    return FlowScene(
        terrain.easting[window[1]], terrain.northing[window[0]], ground[window], np.zeros(0), none, none, title, least_thickness,
        outlines=_rings(releases), meshes=dict(meshes or {}), crs=terrain.crs,
    )  # fmt: skip


def window_around(terrain: "Terrain", releases: "Sequence[Release]", reached: np.ndarray) -> Window:
    """Rows and columns around cells that are reached and the releases."""
    released = np.any([release.thickness > 0 for release in releases], axis=0)
    basemap = Basemap(terrain.easting, terrain.northing, terrain.elevation)
    return basemap.window(reached | released, MARGIN)


def _rings(releases: "Sequence[Release]") -> list[np.ndarray]:
    """Exterior rings (n, 2) of the outlines of releases; of rasters, those around the cells with thickness."""
    from runout.io.vector import outline

    outlines = [r.outline if r.outline is not None else outline(r.thickness > 0, r.terrain) for r in releases]
    parts = [part for outline in outlines for part in getattr(outline, "geoms", [outline])]
    return [np.asarray(part.exterior.coords)[:, :2] for part in parts]


def _place(terrain: "Terrain", shown: "xr.Dataset") -> Window:
    """Rows and columns of the terrain that a dataset holds."""
    column = round((float(shown["x"][0]) - terrain.easting[0]) / terrain.cell_size[0])
    row = round((terrain.northing[0] - float(shown["y"][0])) / terrain.cell_size[1])
    return slice(row, row + shown.sizes["y"]), slice(column, column + shown.sizes["x"])


def _overlap(place: Window, window: Window) -> tuple[Window, Window]:
    """Part of ``place`` that lies in ``window``, counted from the start of each of them."""
    spans = [(max(p.start, w.start), min(p.stop, w.stop)) for p, w in zip(place, window, strict=True)]
    spans = [(low, max(low, high)) for low, high in spans]
    inside, target = (
        tuple(slice(low - start.start, high - start.start) for (low, high), start in zip(spans, starts, strict=True))
        for starts in (place, window)
    )
    return inside, target  # type: ignore[return-value]


def _frame(shown: "xr.DataArray", place: Window, window: Window) -> np.ndarray:
    """A map that lies at ``place`` in the raster, on a window of the raster; 0 elsewhere."""
    inside, target = _overlap(place, window)
    whole = np.zeros([span.stop - span.start for span in window], np.float32)
    whole[target] = shown[inside].values
    return whole


def _particles(path: Path) -> np.ndarray | None:
    """Easting, northing, elevation and speed (frames, n, 4) of the particles; None if the file has none."""
    from runout.io import netcdf

    if not held(path).particles:
        return None
    shown = netcdf.read(path, PARTICLES)
    names = ("particle_easting", "particle_northing", "particle_elevation", "particle_speed")
    return np.stack([shown[name].values for name in names], axis=-1)


def kind_of(output: Path) -> str:
    """Suffix of a film: ".mp4", ".gif", or "" for a folder of PNG.

    Raises ConfigError if it is another one. Raises RenderError if there is no codec for it.
    """
    kind = output.suffix.lower()
    if kind not in KINDS:
        raise ConfigError(f"--output {output}: its name must end in .mp4 or .gif, or be that of a folder for PNG")
    if kind == ".mp4" and not has_codec():
        raise RenderError(NO_CODEC)
    if not kind and output.exists() and not output.is_dir():
        raise ConfigError(f"--output {output}: is a file; name a folder for PNG, or a film .mp4 or .gif")
    return kind


def has_codec() -> bool:
    """Whether MP4 can be written: imageio-ffmpeg is installed, and its ffmpeg is there."""
    if find_spec("imageio_ffmpeg") is None:
        return False
    import imageio_ffmpeg

    try:
        return bool(imageio_ffmpeg.get_ffmpeg_exe())
    except RuntimeError:
        return False


def write_film(frames: Sequence[Path], times: Sequence[float], output: Path, fps: float) -> Path:
    """Write PNG files as a film of ``fps`` frames per second, completely or not at all; returns its path.

    A folder of PNG has the time [s] of each file in ``times.csv``; frames of an earlier film there are removed. Raises ConfigError,
    RenderError or StorageError if the name states no kind of film, there is no codec, or the film cannot be written.
    """
    kind = kind_of(output)
    if not kind:
        return _write_folder(frames, times, output)
    with whole_file(output) as temporary:
        if kind == ".mp4":
            _write_mp4(frames, temporary, fps)
        else:
            _write_gif(frames, temporary, fps)
    return output


def _pictures(frames: Sequence[Path]) -> Iterator[np.ndarray]:
    """Colours (height, width, 3) of uint8, with an even height and width, as the codec needs."""
    from PIL import Image

    for path in frames:
        with Image.open(path) as picture:
            colours = np.asarray(picture.convert("RGB"))
        yield np.ascontiguousarray(colours[: colours.shape[0] // 2 * 2, : colours.shape[1] // 2 * 2])


def _write_mp4(frames: Sequence[Path], path: Path, fps: float) -> None:
    import imageio_ffmpeg

    height, width, _ = next(_pictures(frames[:1])).shape
    choices = {"fps": fps, "codec": CODEC, "quality": QUALITY, "macro_block_size": 2, "ffmpeg_log_level": "error"}
    writer = imageio_ffmpeg.write_frames(str(path), (width, height), **choices)
    try:
        writer.send(None)
        for picture in _pictures(frames):
            writer.send(picture)
    except OSError as cause:
        raise RenderError(f"{path.name}: ffmpeg cannot write it ({cause}); write a GIF or PNG instead") from cause
    finally:
        writer.close()


def _write_gif(frames: Sequence[Path], path: Path, fps: float) -> None:
    """One palette for all frames, so that colours do not flicker."""
    from PIL import Image

    some = [frames[k] for k in sorted({0, len(frames) // 2, len(frames) - 1})]
    palette = palette_of([Image.fromarray(colours) for colours in _pictures(some)])
    paletted = (Image.fromarray(c).quantize(palette=palette, dither=Image.Dither.NONE) for c in _pictures(frames))
    first = next(paletted)
    first.save(path, save_all=True, append_images=paletted, duration=round(1000 / fps), loop=0, optimize=False)


def paletted(path: Path) -> bytes:
    """PNG of 256 colours of a PNG file, about a third of its size."""
    from io import BytesIO

    from PIL import Image

    buffer = BytesIO()
    with Image.open(path) as picture:
        colours = picture.convert("RGB")
        colours.quantize(palette=palette_of([colours]), dither=Image.Dither.FLOYDSTEINBERG).save(buffer, "png", optimize=True)
    return buffer.getvalue()


def palette_of(pictures: Sequence[Any]) -> Any:
    """Picture with a palette of 256 colours: half of them by area, half for the colours of small areas such as the colour bar."""
    from PIL import Image

    some = Image.fromarray(np.concatenate([np.asarray(picture) for picture in pictures]))
    halves = [some.quantize(128, method=way).getpalette() for way in (Image.Quantize.MEDIANCUT, Image.Quantize.MAXCOVERAGE)]
    palette = Image.new("P", (1, 1))
    palette.putpalette([value for half in halves for value in (half or [])[: 3 * 128]])
    return palette


def _write_folder(frames: Sequence[Path], times: Sequence[float], folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob("frame_[0-9][0-9][0-9][0-9].png"):
        old.unlink()
    for frame in frames:
        with whole_file(folder / frame.name) as temporary:
            shutil.copyfile(frame, temporary)
    lines = ["file,time_s", *(f"{frame.name},{time:.9g}" for frame, time in zip(frames, times, strict=True))]
    write_text("\n".join(lines) + "\n", folder / TIMES)
    return folder
