"""Films of frames: MP4, GIF, or a folder of PNG."""

import shutil
from collections.abc import Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from runout.errors import ConfigError, RenderError
from runout.io.atomic import whole_file, write_text

CODEC, QUALITY = "libx264", 7  # of 10
KINDS = (".mp4", ".gif", "")
NO_CODEC = "MP4 needs imageio-ffmpeg: pip install 'runout[view]'; GIF (--output film.gif) and PNG (--output folder) need nothing"
TIMES = "times.csv"


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
