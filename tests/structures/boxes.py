"""Distance fields of analytic boxes, with a facade for each face and patches of about one length."""

from dataclasses import dataclass

import numpy as np

from runout.model.structures import CELLS, Patches, StructureField

FACES = 6  # west, east, south, north, bottom, top in the axes of a box


@dataclass(frozen=True)
class Box:
    """A box with its centre [m], half its sizes [m], the angle [rad] of its first axis from east, and a friction coefficient."""

    centre: tuple[float, float, float]
    half: tuple[float, float, float]
    angle: float = 0.0
    friction: float = 0.0

    @property
    def axes(self) -> np.ndarray:
        """Rows: unit vectors along its axes."""
        c, s = np.cos(self.angle), np.sin(self.angle)
        return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])

    def beyond(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Positions (..., 3) [m] in its axes, and how far they lie beyond its faces along each."""
        q = (x - np.array(self.centre)) @ self.axes.T
        return q, np.abs(q) - np.array(self.half)

    def distance(self, x: np.ndarray) -> np.ndarray:
        """Signed distance [m] of positions (..., 3)."""
        _, d = self.beyond(x)
        return np.linalg.norm(np.maximum(d, 0.0), axis=-1) + np.minimum(d.max(axis=-1), 0.0)


def between(low, high, friction=0.0):
    """Box from its lowest to its highest corner [m]."""
    low, high = np.array(low, float), np.array(high, float)
    return Box(tuple((low + high) / 2), tuple((high - low) / 2), 0.0, friction)


def field_of_boxes(boxes, spacing, band, patch_size=1.0):
    """Field on a lattice of ``spacing`` [m] that is known within ``band`` [m], with patches of about ``patch_size`` [m]."""
    plates = [_plates(box, patch_size) for box in boxes]
    first = np.cumsum([0, *(len(p[0]) for p in plates)])
    reach = [np.linalg.norm(box.half) + band for box in boxes]
    low = np.min([np.array(b.centre) - r for b, r in zip(boxes, reach, strict=True)], axis=0)
    high = np.max([np.array(b.centre) + r for b, r in zip(boxes, reach, strict=True)], axis=0)
    size = CELLS * spacing
    shape = np.ceil((high - low) / size).astype(int)
    middles = low + size * (np.stack(np.indices(shape), axis=-1) + 0.5)
    near = np.min([box.distance(middles) for box in boxes], axis=0) < band + size * np.sqrt(0.75)
    blocks = np.full(shape, -1, np.int32)
    blocks[near] = np.arange(near.sum())
    nodes = np.stack(np.indices((CELLS + 1,) * 3), axis=-1)
    x = low + spacing * (CELLS * np.argwhere(near)[:, None, None, None] + nodes)
    distances = np.array([box.distance(x) for box in boxes])
    nearest = np.abs(distances).argmin(axis=0)
    patch = np.zeros(nearest.shape, np.int32)
    for k, box in enumerate(boxes):
        of_box = nearest == k
        patch[of_box] = first[k] + _patch_rows(box, x[of_box], patch_size)
    return StructureField(
        spacing, tuple(low), blocks, np.clip(distances.min(axis=0), -band, band).astype(np.float32), patch, band,
        Patches(
            *(np.concatenate([p[i] for p in plates]) for i in range(3)),
            np.concatenate([FACES * k + p[3] for k, p in enumerate(plates)]),
            np.concatenate([np.full(len(p[0]), box.friction) for box, p in zip(boxes, plates, strict=True)]),
        ),
    )  # fmt: skip


def _counts(box, size):
    """Number of patches along each axis."""
    return np.maximum(1, np.round(2 * np.array(box.half) / size)).astype(int)


def _plates(box, size):
    """Centre, normal, area and face of the patches of a box, face by face."""
    half, counts, found = np.array(box.half), _counts(box, size), []
    for face in range(FACES):
        axis, others = face // 2, [a for a in range(3) if a != face // 2]
        i, j = (g.ravel() for g in np.indices(counts[others]))
        q = np.zeros((len(i), 3))
        q[:, axis] = half[axis] * (1 if face % 2 else -1)
        q[:, others] = (np.stack([i, j], axis=1) + 0.5) * 2 * half[others] / counts[others] - half[others]
        normal = np.tile(np.sign(q[0, axis]) * box.axes[axis], (len(i), 1))
        area = np.full(len(i), np.prod(2 * half[others] / counts[others]))
        found.append((q @ box.axes + np.array(box.centre), normal, area, np.full(len(i), face)))
    return tuple(np.concatenate(parts) for parts in zip(*found, strict=True))


def _patch_rows(box, x, size):
    """Row, among the patches of a box, of that nearest to each position (n, 3)."""
    half, counts = np.array(box.half), _counts(box, size)
    q, beyond = box.beyond(x)
    axis = beyond.argmax(axis=1)
    face = 2 * axis + (np.take_along_axis(q, axis[:, None], 1)[:, 0] > 0)
    place = np.clip(((q / (2 * half) + 0.5) * counts).astype(int), 0, counts - 1)
    numbers = [counts[1] * counts[2]] * 2 + [counts[0] * counts[2]] * 2 + [counts[0] * counts[1]] * 2
    before = np.cumsum([0, *numbers])[face]
    i = np.where(axis == 0, place[:, 1], place[:, 0])
    j = np.where(axis == 2, place[:, 1], place[:, 2])
    across = np.where(axis == 2, counts[1], counts[2])
    return before + i * across + j
