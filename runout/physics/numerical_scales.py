"""What the grid cannot resolve: the viscosity of the transfers, and how long a shear through the depth of a flow survives it."""

import math
from typing import Any

from runout.physics.tensors import real, vec


def numerical_viscosity(h: Any, wave_length: Any, dt: Any):
    """Kinematic viscosity [m2/s] of a transfer with quadratic weights for motion of ``wave_length`` [m], cells ``h`` [m].

    ``dt`` [s] is the length of a transfer. Measured with eight particles a cell and 6 to 40 cells a wave: 0.80 to 0.95 times
    (h/wave_length)^2 h^2/dt.
    """
    ratio = h / wave_length
    return real(0.95) * ratio * ratio * h * h / dt


def artificial_wave_speed(k: Any, v: Any, g: Any, H: Any, strain: Any):
    """Speed of pressure waves [m/s] of a flow whose stiffness is chosen: c = max(k v, sqrt(g H/strain)).

    ``k`` times the speed ``v`` [m/s] of the flow, or as many as keep the strain of a column of height ``H`` [m] under its weight.
    Stiffer material takes more steps, and each step damps; measured on six problems (docs/decisions, accuracy and time step).
    """
    return max(k * v, math.sqrt(g * H / strain))


def decay_time(viscosity: Any, wave_length: Any):
    """Time [s] in which a viscosity [m2/s] lets motion of ``wave_length`` [m] fall to 1/e."""
    k = real(6.283185307179586) / wave_length
    return real(1.0) / (viscosity * k * k)


def shear_wave_length(depth: Any):
    """Wave length [m] of the slowest shear of a layer of ``depth`` [m]: at rest below, free above, a quarter wave."""
    return real(4.0) * depth


def footprint_area(count: Any, sharing: Any, largest: Any):
    """Plan area [grid cells] over which a particle spreads where ``count`` particles stand over a grid cell, 1 to ``largest``.

    So wide that ``sharing`` particles share every place, at least one cell.
    """
    return min(max(sharing / count, real(1.0)), largest)


def covered_part(volume: Any, particle_volume: Any):
    """Part of a place that the flow covers, 0 to 1, where ``volume`` [m3] of narrow footprints lies over a grid cell.

    All of it from a quarter of a particle on.
    """
    return min(real(4.0) * volume / particle_volume, real(1.0))


def neighbourhood(cell: Any):
    """What is in the square of 2.5 by 2.5 grid cells around a place, where each holds ``cell``: particles, or area [m2]."""
    return real(6.25) * cell


def flowing_part(count: Any, sharing: Any):
    """Part of the volume at a place that flows as one mass, 0 to 1, where ``count`` particles stand over a grid cell.

    All of it where ``sharing`` or more are in the neighbourhood. Half as many or fewer are single particles: they have no
    thickness.
    """
    return min(max(real(2.0) * neighbourhood(count) / sharing - real(1.0), real(0.0)), real(1.0))


def least_thickness(particle_volume: Any, area: Any, sharing: Any):
    """Least thickness [m] that maps can show on grid cells of plan ``area`` [m2]: ``sharing`` particles in a neighbourhood.

    ``particle_volume`` [m3] is that of a particle. Thinner flows are single particles.
    """
    return sharing * particle_volume / neighbourhood(area)


def smoothed_area(width: Any):
    """Area [grid cells] of the footprint that a box of one cell smoothed over squares of ``width`` [cells] is: variances add."""
    return real(1.0) + width * width


def part_beyond(area: Any, narrow: Any, wide: Any):
    """Part of a mass with a footprint of ``area`` that spreads over ``wide``, the rest over ``narrow`` or less, 0 to 1.

    The mean area is kept.
    """
    return min(max((area - narrow) / (wide - narrow), real(0.0)), real(1.0))


def extent_count(around: Any, one: Any):
    """Particles over a grid cell where the 5 x 5 cells of the lattice around a place hold a volume of ``around`` [m3].

    ``one`` [m3] is the volume in a cell of the lattice where one particle stands over a grid cell.
    """
    return real(1.0) / real(25.0) * around / one


def extent_parts(volume: Any, count: Any, sharing: Any, narrow: Any, middle: Any, wide: Any):
    """Volumes [m3] that a cell gives to itself, to each of 3 x 3 and to each of 5 x 5 cells, to find the extent of a flow.

    ``volume`` [m3] is that of the cell, ``count`` that of :func:`extent_count`; ``narrow``, ``middle`` and ``wide`` are the areas
    [grid cells] of the three footprints. The volume is kept.
    """
    area = footprint_area(count, sharing, wide)
    beyond = part_beyond(area, middle, wide)
    within = part_beyond(area, narrow, middle)
    one, three = (real(1.0) - within) * volume, (within - beyond) * volume / real(9.0)
    return vec(one, three, real(1.0) / real(25.0) * beyond * volume)


def depth_count(around: Any, one: Any):
    """As :func:`extent_count`, where 9 x 9 cells of the lattice hold ``around`` [m3]."""
    return around / real(81.0) / one


def depth_scales(
    count: Any, sharing: Any, narrow: Any, middle: Any, wide: Any, in_three: Any, in_five: Any, in_nine: Any
):  # fmt: skip
    """Parts of a cell's mass for footprints of 3 x 3, 5 x 5 and 9 x 9 cells, each over the covered cells there.

    ``count`` is that of :func:`depth_count`; ``in_three``, ``in_five`` and ``in_nine`` are the covered cells in the squares, and
    ``narrow``, ``middle`` and ``wide`` the areas [grid cells] of the footprints. Where no cell is covered, the cell has no mass.
    """
    area = footprint_area(count, sharing, wide)
    first = part_beyond(area, narrow, middle)
    second = part_beyond(area, middle, wide)
    least = real(1e-300)
    return vec((real(1.0) - first) / max(in_three, least), (first - second) / max(in_five, least), second / max(in_nine, least))


def smallest_feature(h: Any, raster_cell: Any):
    """Width [m] of the smallest feature that maps show: two grid cells, or two cells of a coarser raster."""
    return real(2.0) * max(h, raster_cell)


def relief_friction(s: Any, v: Any, g: Any, h: Any):
    """Increase of the friction coefficient [1] by relief of a few cells of ``h`` [m], under a mass of a speed ``v`` [m/s].

    ``s`` [1] is the mean of its absolute slope along the fall of the ground. A mass climbs waves that it cannot follow, which adds
    their slope to the friction angle (Patton 1966), and loses the energy (v s)^2/2 with which they throw it. Fit to slabs on rough
    planes (docs/theory, the ground).
    """
    return s * (real(0.2) + s * (real(3.5) + real(0.7) * v * v / (g * h)))
