"""What a raster file and its side files state of the numbers in it: scale, offset and unit. GDAL applies only some of it.

Side files state a vertical scale or unit in lines of their own: Z_FACTOR and UNIT of SAGA, Zunits of Esri, units in the header of a
binary grid, the vertical scale of a BT file, and the scale of the sources of a virtual raster.
"""

import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from runout.errors import InputError
from runout.io.opening import open_raster
from runout.io.references import header, require_vrt_inside
from runout.io.units import is_stated, metres_in

SIDE_TEXTS = (".prj", ".hdr", ".sgrd")  # that GDAL lists with a raster, besides a raster that is text itself
TEXT_GRIDS = ("AAIGrid", "GRASSASCIIGrid")
LINE = re.compile(
    r"^[ \t]*(z_?factor|z_?scale|z_?units?|vertical_?units?|elev(?:ation)?_?(?:m_)?units?|(?:data|value)[ _]units?|unit)"
    r"(?=[\s=:])[ \t]*[=:]?[ \t]*(\S.*?)?\s*$",
    re.IGNORECASE | re.MULTILINE,
)
BT_SCALE = slice(62, 66)  # bytes of the vertical scale in the header of a BT file [m]; 0 stands for 1
NO_UNIT = ("no", "none", "")


@dataclass(frozen=True)
class StatedScale:
    """Meaning of the numbers of a band: value = ``scale`` x number + ``offset``, in ``unit``; None if no unit is stated."""

    scale: float
    offset: float
    unit: str | None

    def words(self) -> str:
        """The meaning for a message."""
        return f"value = {self.scale:g} x number + {self.offset:g}" + (f" in {self.unit}" if self.unit else "")


def stated_scale(dataset: Any, source: Path | str, error: type[InputError]) -> StatedScale:
    """Scale, offset and unit of the first band of an open rasterio dataset, of its side files and of the sources of a VRT.

    Raises InputError of the given kind if a scale is 0 or not finite, or two statements contradict each other.
    """
    scale, offset, units = dataset.scales[0], dataset.offsets[0], [dataset.units[0]]
    for key, text in _lines(dataset):
        if "factor" in key or "scale" in key:
            scale *= _number(text, key, source, error)
        elif re.fullmatch(r"[\d.eE+-]+", text):  # Esri: units to a metre
            scale, units = scale / _number(text, key, source, error), [*units, "m"]
        else:
            units.append(text)
    if dataset.driver == "BT":
        scale, units = scale * (_bt_scale(dataset.files[0]) or 1.0), ["m"]
    _require_scale(scale, offset, source, error)
    band = StatedScale(scale, offset, _one_unit([unit for unit in units if is_stated(unit)], source, error))
    return _with_sources(band, Path(dataset.files[0]), error) if dataset.driver == "VRT" else band


def require_corner(dataset: Any, source: Path | str, error: type[InputError]) -> None:
    """Raise an error if the header of a grid states its corner along one axis and a centre along the other, or only one of both.

    GDAL reads such a header without a word, and places the grid at the origin or half a cell off.
    """
    if dataset.driver not in ("AAIGrid", "EHdr"):
        return
    corner = {}
    for text in _texts(dataset):
        for axis, kind, value in re.findall(r"^\s*([xy])ll(\w+)\s+(\S+)", text, re.IGNORECASE | re.MULTILINE):
            corner[axis.lower() + kind.lower()] = value
    both = [{"x" + kind, "y" + kind} for kind in ("corner", "center")]
    if set(corner) in both or (dataset.driver == "EHdr" and not corner):
        return
    corner_text = " and ".join(f"{key[0]}ll{key[1:]} {value}" for key, value in sorted(corner.items())) or "neither"
    raise error(
        f"{source}: its header states {corner_text}; xllcorner and yllcorner are needed, or xllcenter and yllcenter: "
        "the corner lies half a cellsize west and south of the centre"
    )


def _require_scale(scale: float, offset: float, source: Path | str, error: type[InputError]) -> None:
    if scale == 0.0 or not abs(scale) < float("inf") or not abs(offset) < float("inf"):
        remedy = f"state the right one, for example `gdal_edit.py -scale 1 -offset 0 {source}`"
        raise error(f"{source}: the file states the scale {scale:g} and the offset {offset:g} of its numbers; {remedy}")


def _lines(dataset: Any) -> Iterator[tuple[str, str]]:
    """Keys and values of all lines on vertical scale and unit."""
    for text in _texts(dataset):
        lines = ((key.lower(), value.strip("{} \"'")) for key, value in LINE.findall(text))
        yield from ((key, value) for key, value in lines if value.lower() not in NO_UNIT)
    titles = dataset.tags(ns="ENVI").get("z_plot_titles", "").strip("{} ").split(",", 1)
    if len(titles) == 2 and metres_in(titles[1]) is not None:
        yield "z plot titles", titles[1].strip()


def _texts(dataset: Any) -> Iterator[str]:
    """Beginnings of the text files of a raster."""
    for name in dataset.files:
        path = Path(name)
        is_side = path.suffix.lower() in SIDE_TEXTS or path.name.lower() == "prj.adf"
        if path.is_file() and (is_side or (dataset.driver in TEXT_GRIDS and name == dataset.files[0])):
            yield header(path).decode("latin-1").replace("\r", "\n")


def _number(text: str, key: str, source: Path | str, error: type[InputError]) -> float:
    try:
        number = float(text)
    except ValueError:
        number = 0.0
    if number == 0.0 or not abs(number) < float("inf"):
        raise error(f"{source}: its side file states {key} {text!r}; write a number other than 0, or remove the line")
    return number


def _bt_scale(name: str) -> float:
    return float(struct.unpack("<f", header(Path(name))[BT_SCALE])[0])


def _with_sources(band: StatedScale, path: Path, error: type[InputError]) -> StatedScale:
    """What a VRT and its sources state: GDAL copies the numbers of the sources and leaves out what they mean.

    Raises InputError of the given kind if the sources state different meanings, or others than the VRT.
    """
    remedy = "convert them before you build the VRT: `gdal_translate -unscale`, `gdal_calc.py`"
    alike: dict[tuple[float, float, float | str], tuple[StatedScale, Path]] = {}
    for source in require_vrt_inside(path, error):
        with open_raster(source, error) as file:
            if file.driver != "VRT":  # the sources of that are on the list
                own = stated_scale(file, source, error)
                alike.setdefault((own.scale, own.offset, _meaning(own.unit)), (own, source))
    if len(alike) > 1:
        (one, first), (other, second), *_ = alike.values()
        raise error(f"{path}: its sources differ: {first.name} states {one.words()}, {second.name} {other.words()}; {remedy}")
    own, source = next(iter(alike.values()), (StatedScale(1.0, 0.0, None), path))
    plain, packed = (own.scale, own.offset) == (1.0, 0.0), (band.scale, band.offset) != (1.0, 0.0)
    rescaled = packed or b"<ScaleRatio>" in path.read_bytes()
    if (rescaled and not plain and (own.scale, own.offset) != (band.scale, band.offset)) or (
        band.unit and own.unit and _meaning(band.unit) != _meaning(own.unit)
    ):
        raise error(f"{path}: states {band.words()}, its source {source.name} {own.words()}; {remedy}")
    return StatedScale(*((band.scale, band.offset) if rescaled else (own.scale, own.offset)), band.unit or own.unit)


def _meaning(unit: str | None) -> float | str:
    """Metres in a unit of length; other units as they are."""
    return metres_in(unit or "m") or str(unit)


def _one_unit(units: list[str], source: Path | str, error: type[InputError]) -> str | None:
    """The unit that all statements mean; an error if they differ."""
    different = {_meaning(unit) for unit in units}
    if len(different) > 1:
        raise error(f"{source}: the raster and its side files state different units ({', '.join(units)}); correct one of them")
    return units[-1] if units else None
