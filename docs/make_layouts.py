"""Draws the data layout of each backend for docs/backends: `python docs/make_layouts.py`."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, Rectangle

IMAGES = Path(__file__).parent / "images"
PARTICLE, NODE, INDEX, SCRATCH, PLAIN = "#f4b76b", "#8fb8de", "#c5b3dd", "#a9d3a2", "#ffffff"
INK, PALE = "#222222", "#bbbbbb"


def canvas(width: float, height: float) -> tuple[Figure, Any]:
    """A figure of that many inches, and axes whose unit is a tenth of an inch."""
    figure = Figure(figsize=(width, height), facecolor="white")
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=(0, 10 * width), ylim=(0, 10 * height))
    axes.axis("off")
    return figure, axes


def cell(axes: Any, x: float, y: float, w: float, h: float, color: str, text: str = "", size: float = 8) -> None:
    """A box with its lower left corner at x, y, and a text in its middle."""
    axes.add_patch(Rectangle((x, y), w, h, facecolor=color, edgecolor=INK, linewidth=0.7))
    axes.text(x + w / 2, y + h / 2, text, ha="center", va="center", fontsize=size, color=INK)


def note(axes: Any, x: float, y: float, text: str, size: float = 8, **how: Any) -> None:
    """A text whose upper left corner is at x, y."""
    axes.text(x, y, text, va="top", fontsize=size, color=INK, linespacing=1.3, **how)


def arrow(axes: Any, start: tuple[float, float], end: tuple[float, float], text: str = "", bend: float = 0.0) -> None:
    """An arrow with a text above its middle."""
    style = f"arc3,rad={bend}"
    axes.add_patch(FancyArrowPatch(start, end, arrowstyle="-|>", mutation_scale=11, color=INK, connectionstyle=style))
    axes.text((start[0] + end[0]) / 2, (start[1] + end[1]) / 2 + 0.5, text, ha="center", va="bottom", fontsize=8, color=INK)


def squares(axes: Any, x: float, y: float, columns: int, rows: int, side: float, colors: dict[tuple[int, int], str]) -> None:
    """A lattice of squares; ``colors`` by column and row from the lower left."""
    for i in range(columns):
        for j in range(rows):
            color = colors.get((i, j), PLAIN)
            axes.add_patch(Rectangle((x + i * side, y + j * side), side, side, facecolor=color, edgecolor=PALE, linewidth=0.6))


def rows_of(axes: Any, x: float, y: float, width: float, entries: list[tuple[str, str]]) -> None:
    """Arrays one below the other, each a box with a text; ``entries`` are texts and colours."""
    for k, (text, color) in enumerate(entries):
        cell(axes, x, y - 2.4 * (k + 1), width, 2.1, color, text)


def draw_reference() -> Figure:
    """One dense grid, arrays of particles, and tables of 27 nodes for each."""
    figure, axes = canvas(9.6, 3.4)
    _draw_dense_grid(axes)
    note(axes, 40, 33, "Particles", 9, weight="bold")
    names = [
        "node (n, 3) int",
        "offset (n, 3)",
        "velocity (n, 3)",
        "affine (n, 3, 3)",
        "strain (n, 6)",
        "mass, volume, history (n)",
    ]
    rows_of(axes, 40, 30.5, 18, [(name, PARTICLE) for name in names])
    note(axes, 60, 33, "Stencils", 9, weight="bold")
    tables = ["node (n, 27) int", "weight (n, 27)", "arm (n, 27, 3)", "slope (n, 27, 3)"]
    rows_of(axes, 60, 30.5, 16, [(name, INDEX) for name in tables])
    note(axes, 78, 33, "Nodes", 9, weight="bold")
    rows_of(axes, 78, 30.5, 16, [("mass (nodes, 1)", NODE), ("velocity (nodes, 3)", NODE)])
    arrow(axes, (52, 11), (84, 11), "scatter: one bincount per component")
    arrow(axes, (84, 6.5), (52, 6.5), "gather: one einsum over 27 nodes")
    note(axes, 40, 4, "n particles, ordered by identity; float64; stencils are made anew in each step")
    return figure


def _draw_dense_grid(axes: Any) -> None:
    note(axes, 1, 33, "Dense grid around all particles (2D sketch)", 9, weight="bold")
    side, low, floor = 2.6, 1.5, 6.0
    nodes = [(i, j) for i in range(3, 6) for j in range(2, 5)]
    squares(axes, low, floor, 12, 9, side, {})
    for i in range(13):
        for j in range(10):
            used = (i, j) in nodes
            axes.plot(low + side * i, floor + side * j, "s", ms=5 if used else 2, color="#3b78b5" if used else PALE)
    across = np.linspace(0.6, 11.2, 22)
    for row in range(4):
        height = 0.5 + (row + 0.5) * 1.5 / (1 + 0.004 * across**2.6)
        axes.plot(low + side * across, floor + side * height, "o", ms=3.2, color="#c77d1a")
    axes.plot(low + side * 4.13, floor + side * 3.1, "o", ms=6, color="#c03020")
    note(axes, low, 4, "blue: the nodes of the red particle (27 in 3D)")


def draw_scan() -> Figure:
    """Blocks behind a table of superblocks, slots of particles, arenas and nodes."""
    figure, axes = canvas(10.4, 5.6)
    _draw_blocks(axes)
    _draw_slots(axes)
    _draw_arenas(axes)
    return figure


def _draw_blocks(axes: Any) -> None:
    note(axes, 1, 55, "1  Index (2D sketch)", 9, weight="bold")
    squares(axes, 2, 45, 4, 2, 3, {(1, 0): INDEX, (2, 0): INDEX, (1, 1): INDEX})
    note(axes, 15.5, 51, "table of superblocks:\n4 bytes each")
    owners = {(i, j) for i in range(6) for j in range(6) if 5 <= i + j <= 6}
    nodes = {(i + a, j + b) for i, j in owners for a in (0, 1) for b in (0, 1)} - owners
    squares(axes, 2, 20, 8, 8, 2.6, dict.fromkeys(nodes, NODE) | dict.fromkeys(owners, PARTICLE))
    arrow(axes, (8, 44.6), (12, 41.4))
    note(
        axes,
        1.5,
        19,
        "one superblock: 8 x 8 x 8 blocks of\n4 x 4 x 4 cells. Orange: owner blocks\n"
        "(may hold particles). Blue: node blocks\n(only nodes). Owners come first.",
    )


def _draw_slots(axes: Any) -> None:
    note(axes, 34, 55, "2  Particles in slots; a block owns a range of slots", 9, weight="bold")
    at = 34.0
    for width, text, color in (
        (12, "block 0", PARTICLE),
        (2, "", PLAIN),
        (16, "block 1", PARTICLE),
        (3, "", PLAIN),
        (9, "block 2", PARTICLE),
        (6, "free", PLAIN),
    ):
        cell(axes, at, 47.5, width, 3.2, color, text)
        at += width
    arrow(axes, (48, 47.3), (34.5, 43.4))
    arrow(axes, (64, 47.3), (81.5, 43.4))
    for k, text in enumerate(("cell 0", "cell 1", "cell 2", "...", "cell 63")):
        cell(axes, 34 + 9.6 * k, 40.2, 9.6, 2.9, PARTICLE, text)
    note(axes, 34, 39.6, "order: slots of a block by cell; starts: first entry of each of the 64 cells")
    for k, text in enumerate(("m, momentum", "fx, A column 0", "fy, A column 1", "fz, A column 2")):
        cell(axes, 34 + 12 * k, 32.3, 12, 2.9, SCRATCH, text)
    note(axes, 34, 31.7, "record: 16 numbers = one cache line in float32; the transfer to the grid reads only this")
    for k, (width, text) in enumerate(((24, "strain b - I (6)"), (12, "history"), (12, "volume"))):
        cell(axes, 34 + (0, 24, 36)[k], 24.4, width, 2.9, SCRATCH, text)
    note(axes, 34, 23.8, "state: 8 numbers, read on the way back from the grid")


def _draw_arenas(axes: Any) -> None:
    note(axes, 1, 9, "3  Arenas and nodes", 9, weight="bold")
    own = {(i, j): NODE for i in range(4) for j in range(4)}
    squares(axes, 34, 4, 6, 6, 2.0, {**{(i, j): SCRATCH for i in range(6) for j in range(6)}, **own})
    note(axes, 34, 3.4, "arena: 6 x 6 x 6 nodes, 4 numbers each")
    squares(axes, 68, 6, 4, 4, 2.0, own)
    note(axes, 68, 3.4, "node block: 4 x 4 x 4 nodes, mass and velocity")
    arrow(axes, (46.8, 11), (67, 11), "")
    note(axes, 47.5, 15.6, "a node sums the up to 8\narenas that overlap it")
    note(axes, 47.5, 9.8, "in a fixed order, while\nthey are in the cache")
    arrow(axes, (28, 10), (33.4, 10))
    note(axes, 1, 6.5, "A block adds its particles into an arena;\nthen another block uses the memory.")
    note(axes, 80, 14.6, "blue: nodes of the block itself\ngreen: nodes of neighbours one\nstep up in x, y or z")


def draw_hash() -> Figure:
    """A hash table of block keys, a matrix of particles, lists of cells, and tiles in shared memory."""
    figure, axes = canvas(10.4, 5.6)
    _draw_table(axes)
    _draw_matrix(axes)
    _draw_tiles(axes)
    return figure


def _draw_table(axes: Any) -> None:
    note(axes, 1, 55, "1  Index", 9, weight="bold")
    entries = ["", "key 7", "", "key 2", "key 9", "", "", "key 4"]
    for k, text in enumerate(entries):
        cell(axes, 2, 48.5 - 2.8 * k, 8, 2.8, INDEX if text else PLAIN, text)
    note(axes, 1.5, 28.2, "hash table of block\nkeys; a collision takes\nthe next entry")
    for k, text in enumerate(("key 2", "key 4", "key 7", "key 9")):
        cell(axes, 19, 43.5 - 3 * k, 10, 3, INDEX, f"{k}: {text}")
    for start, end in ((47.1, 39), (41.5, 45), (38.7, 36), (30.3, 42)):
        arrow(axes, (10.2, start), (18.8, end))
    note(axes, 18, 33.4, "blocks, numbered in\norder of their keys;\nneighbours by number")


def _draw_matrix(axes: Any) -> None:
    note(axes, 36, 55, "2  Particle matrix: 24 rows, one column per particle", 9, weight="bold")
    labels = ("mass (1)", "momentum (3)", "offset (3)", "affine A (9)", "strain b - I (6)", "history, volume (2)")
    for j, text in enumerate(labels):
        cell(axes, 36, 48.5 - 2.6 * j, 46, 2.6, PARTICLE)
        note(axes, 36.6, 50.5 - 2.6 * j, text)
    for k, text in enumerate(("block 0", "block 1", "block 2")):
        cell(axes, 55 + 9 * k, 31.5, 9, 2.6, INDEX, text)
        axes.plot([55 + 9 * k] * 2, [35.5, 51.1], color=INK, linewidth=0.7)
    note(axes, 83.5, 50, "A sort moves every row\nto the row beside it, into\nthe order of the blocks.")
    note(axes, 83.5, 42, "Neighbouring threads\nread neighbouring\nnumbers of one row.")
    cell(axes, 36, 26.3, 46, 2.6, INDEX, "order: places of the particles, cell by cell; 65 starts per block")
    note(axes, 36, 25.6, "Lists are made anew in each step. Between two sorts a particle keeps its column.")


def _draw_tiles(axes: Any) -> None:
    note(axes, 1, 20.8, "3  One block of threads per block of cells", 9, weight="bold")
    squares(axes, 2, 6, 4, 4, 2.6, {(i, j): PARTICLE for i in range(4) for j in range(4)})
    note(axes, 1.5, 5, "64 threads, one per cell;\n27 sums in registers")
    arrow(axes, (13.5, 11.5), (25.5, 11.5), "add")
    own = {(i, j): NODE for i in range(4) for j in range(4)}
    squares(axes, 27, 6, 6, 6, 2.0, {**{(i, j): SCRATCH for i in range(6) for j in range(6)}, **own})
    note(axes, 26.5, 5, "tile: 6 x 6 x 6 nodes in\nshared memory")
    arrow(axes, (40, 11.5), (53.5, 11.5), "atomic add")
    squares(axes, 55, 7.5, 4, 4, 2.0, own)
    note(axes, 53, 5, "nodes: 64 per block,\nmass and momentum")
    arrow(axes, (64, 11.5), (76, 11.5), "read")
    squares(axes, 78, 6, 8, 8, 1.5, {(i, j): SCRATCH for i in range(8) for j in range(8)})
    note(axes, 77, 5, "grid to particles: tile of 8 x 8 x 8 nodes;\nparticles in memory order")


def main() -> None:
    """Write docs/images/backend_*.png."""
    for name, draw in (("reference", draw_reference), ("scan", draw_scan), ("hash", draw_hash)):
        draw().savefig(IMAGES / f"backend_{name}.png", dpi=140)


if __name__ == "__main__":
    main()
