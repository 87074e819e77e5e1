"""Triangles of mesh files: OBJ, PLY, STL and GLB through trimesh, whole, finite, and with z up."""

import logging
import re
import struct
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from runout.errors import InputError
from runout.io.boundary import exists, require_regular

MESHES = (".obj", ".ply", ".stl", ".glb")
OTHER_MESHES = (".gltf", ".off", ".dae", ".fbx", ".3ds", ".3mf", ".blend", ".ifc", ".step", ".stp", ".stpz", ".wrl", ".skp")
DECIMALS = 8  # of coordinates; vertices that agree to so many are one
STL_HEADER, STL_FACE, PLY_HEADER = 84, 50, 1 << 16  # bytes
FAR, MOST_FAR, FEWEST = 1000.0, 3, 16  # ratio of extents; positions that are left out, and of how many each is one
HUGE = 1e40  # coordinates beyond which the volume of a body is no number
UNREADABLE = (
    ValueError, LookupError, TypeError, AttributeError, AssertionError, OSError, ArithmeticError, MemoryError, RuntimeError,
    NameError, ImportError, struct.error,
)  # fmt: skip
BEGINNINGS = {".ply": b"ply", ".glb": b"glTF"}
OBJ_ZERO = re.compile(rb"^f(?=[ \t])[^\n]*?[ \t]0+(?=[/ \t\r\n])", re.MULTILINE)


@dataclass(frozen=True)
class MeshPart:
    """A part of a mesh file: what has one node or one material there."""

    name: str  # as the file names it
    vertices: np.ndarray  # (v, 3): in the units of the file, z up
    faces: np.ndarray  # (f, 3) of int: rows of `vertices`

    @property
    def is_closed(self) -> bool:
        """Whether every edge has two faces."""
        return bool((edges_of(self.faces)[2] == 2).all())

    def merged(self) -> "MeshPart":
        """The part with equal vertices as one, and without vertices of no face."""
        used, row = np.unique(self.faces, return_inverse=True)
        vertices, same = np.unique(np.round(self.vertices[used], DECIMALS) + 0.0, axis=0, return_inverse=True)
        return MeshPart(self.name, vertices, same.ravel()[row].reshape(-1, 3))


def edges_of(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Edges (e, 2) of faces (f, 3), the edge of each side (3 f,), and the number of faces (e,) at each edge."""
    sides = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    width = int(faces.max(initial=0)) + 1
    codes, row, count = np.unique(sides[:, 0] * width + sides[:, 1], return_inverse=True, return_counts=True)
    return np.column_stack(np.divmod(codes, width)), row.ravel(), count


def read_mesh(path: Path, error: type[InputError], formats: Sequence[str] = MESHES) -> list[MeshPart]:
    """Parts of a mesh file that have faces.

    Raises InputError of the given kind if the file is missing, of another format, cut off, has no faces, faces of vertices that it
    does not hold, or vertices that are no finite numbers.
    """
    names = ", ".join(kind[1:].upper() for kind in formats[:-1]) + f" or {formats[-1][1:].upper()}"
    again = f"export it again as {names}"
    if path.suffix.lower() not in formats:
        raise error(f"{path}: {path.suffix or 'a name without ending'} is no format of meshes that is read; {again}")
    if not exists(path):
        raise error(f"{path}: no such file; check the path")
    if require_regular(path, error).is_dir():
        raise error(f"{path}: is a folder; name the mesh file in it")
    _require_whole(path, again, error)
    parts = [part for part in _loaded(path, again, error) if len(part.faces)]
    if not parts:
        raise error(f"{path}: holds no faces; {again}, with triangles")
    return [_sound(part, path, again, error) for part in parts]


def _require_whole(path: Path, again: str, error: type[InputError]) -> None:
    """Refuse a file that begins as one of another format, or is shorter than it states."""
    kind, size = path.suffix.lower(), path.stat().st_size
    with path.open("rb") as file:
        start = file.read(STL_HEADER)
    for other, beginning in BEGINNINGS.items():
        if start.startswith(beginning) and kind != other:
            raise error(f"{path}: begins as a {other[1:].upper()} file; rename it to {path.stem}{other}, or {again}")
    if kind in BEGINNINGS and not start.startswith(BEGINNINGS[kind]):
        raise error(f"{path}: does not begin as a {kind[1:].upper()} file; {again}")
    if kind == ".ply" and not _ply_header(path):
        raise error(f"{path}: is cut off in its header; copy or {again}")
    whole_size = None
    if kind == ".glb":
        whole_size = struct.unpack("<I", start[8:12].ljust(4, b"\0"))[0]
    elif kind == ".stl" and not start.lstrip().startswith(b"solid"):
        whole_size = STL_HEADER + STL_FACE * struct.unpack("<I", start[80:84].ljust(4, b"\0"))[0]
    if whole_size is not None and size != whole_size:
        raise error(
            f"{path}: is cut off, or no {kind[1:].upper()} file: it has {size} bytes, its header {whole_size}; copy or {again}"
        )


def _loaded(path: Path, again: str, error: type[InputError]) -> Iterator[MeshPart]:
    """Parts as trimesh reads them, with the transforms of their nodes."""
    import trimesh

    logging.getLogger("trimesh").addHandler(logging.NullHandler())  # else tracebacks of its own on the terminal
    fault = _obj_zero(path) if path.suffix.lower() == ".obj" else ""
    if fault:
        raise error(f"{path}: {fault}; {again}")
    try:
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # on numbers that are refused later
            scene = trimesh.load_scene(path, process=False, skip_materials=True)
            placed = [(str(node), *scene.graph[node]) for node in scene.graph.nodes_geometry]
            parts = [_placed(node, matrix, scene.geometry[name], path) for node, matrix, name in placed]
    except UNREADABLE as cause:
        fault = _obj_fault(path) if path.suffix.lower() == ".obj" else ""
        reason = fault or f"cannot be read as a mesh ({' '.join(str(cause).split())[:120] or type(cause).__name__})"
        raise error(f"{path}: {reason}; {again}") from cause
    if path.suffix.lower() == ".ply":
        _require_counts(path, parts, again, error)
    yield from parts


def _placed(name: str, matrix: np.ndarray, mesh: Any, path: Path) -> MeshPart:
    """A geometry of trimesh, in the place of its node, with z up: y is up in GLB files (glTF 2.0, 3.3)."""
    vertices = np.asarray(mesh.vertices, np.float64).reshape(-1, 3)
    if not np.array_equal(matrix, np.eye(4)):
        vertices = vertices @ matrix[:3, :3].T + matrix[:3, 3]
    faces = np.asarray(getattr(mesh, "faces", ()), np.int64).reshape(-1, 3)
    if path.suffix.lower() == ".glb":
        vertices = np.column_stack([vertices[:, 0], -vertices[:, 2], vertices[:, 1]])
    return MeshPart(name, vertices, faces[:, ::-1] if np.linalg.det(matrix[:3, :3]) < 0 else faces)


def _sound(part: MeshPart, path: Path, again: str, error: type[InputError]) -> MeshPart:
    """The part; refused if its faces have other vertices, or vertices are not finite or far away."""
    count = len(part.vertices)
    wrong = ((part.faces < 0) | (part.faces >= count)).any(1)
    if wrong.any():
        corners = ", ".join(map(str, part.faces[wrong.argmax()]))
        raise error(f"{path}: face {wrong.argmax() + 1} has vertices {corners}; the mesh has vertices 0 to {count - 1}; {again}")
    lost = ~np.isfinite(part.vertices).all(1)
    if lost.any():
        x, y, z = part.vertices[lost.argmax()]
        raise error(
            f"{path}: {lost.sum()} of {count} vertices are no finite numbers, the first is ({x:.10g}, {y:.10g}, {z:.10g}); {again}"
        )
    huge = np.abs(part.vertices).max(1) > HUGE
    if huge.any():
        x, y, z = part.vertices[huge.argmax()]
        where = f"the first at ({x:.4g}, {y:.4g}, {z:.4g})"
        raise error(f"{path}: {huge.sum()} of {count} vertices lie beyond the Earth, {where}; {again}")
    far = _far_vertices(part)
    if len(far):
        x, y, z = far[0]
        many = f"{len(far)} {'vertex lies' if len(far) == 1 else 'vertices lie'}"
        where = f"the first at ({x:.10g}, {y:.10g}, {z:.10g})"
        raise error(f"{path}: {many} far from all others, {where}; remove what is there, or {again}")
    return part


def _far_vertices(part: MeshPart) -> np.ndarray:
    """Vertices (n, 3) at up to three positions along an axis of the plan without which the mesh is ``FAR`` times smaller."""
    vertices = part.vertices[np.unique(part.faces)]
    for axis in (0, 1):
        places = np.unique(vertices[:, axis])
        for count in range(1, min(MOST_FAR, len(places) // FEWEST) + 1):
            spans = places[len(places) - 1 - count :] - places[: count + 1]
            first = int(spans.argmin())
            if FAR * spans[first] < places[-1] - places[0]:
                last = places[len(places) - 1 - count + first]
                beyond = (vertices[:, axis] < places[first]) | (vertices[:, axis] > last)
                return np.unique(vertices[beyond], axis=0)  # type: ignore[no-any-return]
    return np.empty((0, 3))


def _ply_header(path: Path) -> bytes:
    """Header of a PLY file; empty if it has no end."""
    with path.open("rb") as file:
        header, end, _ = file.read(PLY_HEADER).partition(b"end_header")
    return header if end else b""


def _require_counts(path: Path, parts: Sequence[MeshPart], again: str, error: type[InputError]) -> None:
    """Refuse a PLY file that holds less than its header states."""
    counts = {"vertex": sum(len(part.vertices) for part in parts), "face": sum(len(part.faces) for part in parts)}
    for element, many in (("vertex", "vertices"), ("face", "faces")):
        match = re.search(rb"element\s+" + element.encode() + rb"\s+(\d+)", _ply_header(path))
        if match and counts[element] < int(match[1]):
            raise error(f"{path}: is cut off: {counts[element]} of its {int(match[1])} {many} can be read; copy or {again}")


def _obj_zero(path: Path) -> str:
    """The line of a face with vertex 0, which OBJ does not have; empty without."""
    content = path.read_bytes()
    match = OBJ_ZERO.search(content)
    if match is None:
        return ""
    line = content.count(b"\n", 0, match.start()) + 1
    return f"line {line}: a face has vertex 0; vertices count from 1"


def _obj_fault(path: Path) -> str:
    """What is wrong in the first line of an OBJ file that cannot be read; empty if nothing is found."""
    lines = path.read_text(errors="replace").splitlines()
    count = sum(line.startswith(("v ", "v\t")) for line in lines)
    for number, line in enumerate(lines, 1):
        key, *words = line.split() or [""]
        try:
            if key == "v" and (len(words) < 3 or not [float(word) for word in words]):
                return f"line {number}: {line.strip()[:60]!r} has fewer than three coordinates"
            rows = [int(word.split("/")[0]) for word in words] if key == "f" else []
        except ValueError:
            return f"line {number}: {line.strip()[:60]!r} has a word that is no number (decimals have a point)"
        beyond = [row for row in rows if abs(row) > count]
        if beyond:
            return f"line {number}: a face has vertex {beyond[0]}; the file has {count} vertices"
    return ""
