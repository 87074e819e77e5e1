"""Groups of arrays of the contact with structures (:mod:`runout.backends.scan.structure_detection`); rules as in ``groups``.

Sizes: ``near`` owner blocks near structures, ``nodes`` node blocks that they reach, ``rows`` particles of near blocks.
"""

from typing import NamedTuple

import numpy as np


class Field(NamedTuple):
    """The :class:`runout.model.structures.StructureField` of the scene."""

    blocks: np.ndarray  # (nx, ny, nz): row of each block of the lattice; -1 where there is none
    # distance, patch (n, 729): distance [m] at the nodes of a block, and the nearest patch
    distance: np.ndarray
    patch: np.ndarray
    # origin, spacing (3,), (1,): first node [m]; edge of a cell [m]
    origin: np.ndarray
    spacing: np.ndarray
    # centre, normal (patches, 3): centre of each patch in cells of the lattice; outward normal
    centre: np.ndarray
    normal: np.ndarray
    friction: np.ndarray  # (releases, patches): friction coefficient [1]


class Near(NamedTuple):
    """Blocks near structures."""

    owners: np.ndarray  # (near,): their numbers in the index
    up: np.ndarray  # (near, 8): node blocks of each, by their row in ``nodes``
    nodes: np.ndarray  # (nodes,): their numbers in the index
    down: np.ndarray  # (nodes, 8): rows in ``owners`` of the block itself and one step down; -1 where there is none


class Touching(NamedTuple):
    """Rows of particles that touch structures, by near block."""

    # place, number, entering (near + 1,), (near,), (near,): first row; rows; those whose centre would enter a structure
    place: np.ndarray
    number: np.ndarray
    entering: np.ndarray
    # entry, patch (rows,): where ``Particles.order`` holds the slot of the particle, which may change within a transfer; patch
    # that it touches
    entry: np.ndarray
    patch: np.ndarray
    measured: np.ndarray  # (rows, 8): normal, gap [m], velocity before the substep [m/s], distance [m]
    # given, push (rows, 4): 1 where the centre would enter, else 0, and the impulse [N s] that the nodes hold already; work [J]
    # and impulse [N s]
    given: np.ndarray
    push: np.ndarray
    shares: np.ndarray  # (near, 216, 4): what the contacts of a block give to its 6 x 6 x 6 nodes: weight and impulse
    # compliance, inverse (nodes, 64): sum of the weights of all contacts over mass, and inverse mass [1/kg], of the nodes
    compliance: np.ndarray
    inverse: np.ndarray
