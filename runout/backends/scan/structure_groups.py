"""Groups of arrays of the contact with structures (:mod:`runout.backends.scan.structure_detection`); rules as in ``groups``.

Sizes: ``near`` owner blocks near structures, ``nodes`` node blocks that they reach, ``rows`` particles of near blocks.
"""

from typing import NamedTuple

import numpy as np


class Field(NamedTuple):
    """The :class:`runout.model.structures.StructureField` of the scene.

    Attributes
    ----------
    blocks : (nx, ny, nz) int32
        Row of each block of the lattice; -1 where there is none.
    distance, patch : (n, 729) float32, int32
        Distance [m] at the nodes of a block, and the nearest patch.
    origin, spacing : (3,), (1,) float64
        First node [m]; edge of a cell [m].
    centre, normal : (patches, 3) float64, real
        Centre of each patch in cells of the lattice; outward normal.
    friction : (releases, patches) real
        Friction coefficient [1].
    """

    blocks: np.ndarray
    distance: np.ndarray
    patch: np.ndarray
    origin: np.ndarray
    spacing: np.ndarray
    centre: np.ndarray
    normal: np.ndarray
    friction: np.ndarray


class Near(NamedTuple):
    """Blocks near structures.

    Attributes
    ----------
    owners : (near,) int32
        Their numbers in the index.
    up : (near, 8) int32
        Node blocks of each, by their row in ``nodes``.
    nodes : (nodes,) int32
        Their numbers in the index.
    down : (nodes, 8) int32
        Rows in ``owners`` of the block itself and one step down; -1 where there is none.
    """

    owners: np.ndarray
    up: np.ndarray
    nodes: np.ndarray
    down: np.ndarray


class Touching(NamedTuple):
    """Rows of particles that touch structures, by near block.

    Attributes
    ----------
    place, number, entering : (near + 1,), (near,), (near,) int64
        First row; rows; those whose centre would enter a structure.
    entry, patch : (rows,) int32
        Where ``Particles.order`` holds the slot of the particle, which may change within a transfer; patch that it touches.
    measured : (rows, 8) real
        Normal, gap [m], velocity before the substep [m/s], distance [m].
    given, push : (rows, 4) real
        1 where the centre would enter, else 0, and the impulse [N s] that the nodes hold already; work [J] and impulse [N s].
    shares : (near, 216, 4) real
        What the contacts of a block give to its 6 x 6 x 6 nodes: weight and impulse.
    compliance, inverse : (nodes, 64) real
        Sum of the weights of all contacts over mass, and inverse mass [1/kg], of the nodes.
    """

    place: np.ndarray
    number: np.ndarray
    entering: np.ndarray
    entry: np.ndarray
    patch: np.ndarray
    measured: np.ndarray
    given: np.ndarray
    push: np.ndarray
    shares: np.ndarray
    compliance: np.ndarray
    inverse: np.ndarray
