"""Frictional contact of a particle with the ground: one impulse per contact particle.

A law of basal friction (:mod:`runout.friction`) states what resists sliding, :func:`law_resistance`; the solve is one for all.

The impulse acts on the grid before velocities return to the particles. Everything is per particle: the velocity u that
the particle would receive, the normal n, the gap, and the lumped compliance A = sum_n w_n S_n / m_n [1/kg] where S_n is
the sum of the weights of all contact particles at node n. A law that needs it gets the ground area of the particle too, its share
of the columns of nodes around (:func:`area_share`).
"""

import math
from typing import Any

from runout.physics.tensors import dot, real, vec

STILL = 0.001  # cells that a particle may move in a step if its impulse starts from the force of the step before
RIM = 0.5  # of the mean sum of weights around a contact: the least that divides its own weights


def in_contact(gap: Any, normal_velocity: Any, dt: Any, band: Any):
    """Whether a particle touches the ground within the step; ``band`` [m] is the tolerance."""
    approach = normal_velocity
    if approach > real(0.0):
        approach = real(0.0)
    return gap + dt * approach < band


def reach(radius: Any, speed: Any, dt: Any, band: Any):
    """Distance [m] of a particle's centre from the ground beyond which :func:`in_contact` fails; with a reserve for rounding."""
    return radius + band + real(1.001) * dt * speed


def approach_speed(v: Any, east: Any, north: Any, more_east: Any, more_north: Any):
    """Speed [m/s] at which a velocity may at most approach a ground with slopes within ``more_east`` of ``east`` and so northwards.

    With the upward normal n = (-a, -b, 1) / sqrt(1 + a^2 + b^2) of a ground with slopes a and b, -v.n <= v1 a + v2 b - v3 where
    that is positive.
    """
    fallen = v[0] * east + v[1] * north - v[2]
    return max(real(0.0), fallen + abs(v[0]) * more_east + abs(v[1]) * more_north)


def normal_target(un: Any, gap: Any, dt: Any):
    """Least normal velocity [m/s] that the ground admits, where it would be ``un`` without its impulse.

    Above the ground -gap/dt, so that the gap closes and no more. The lumped compliance is that of neighbours which are pushed
    alike; a particle that is pushed harder than they are, at the rim of a flow, keeps some of its downward velocity and sinks.
    So a particle below rises, by a twentieth of its depth in a step, but at most at half the speed that is to be stopped: what
    it gets back is a quarter of the energy that the ground takes, and a static load still presses in every step.
    """
    target = -gap / dt
    if gap < real(0.0):
        target = real(0.05) * target
        if target > real(-0.5) * un:
            target = real(-0.5) * un
        if target < real(0.0):
            target = real(0.0)
    return target


def law_resistance(normal: Any, slip: Any, area: Any, dt: Any, basal: Any):
    """What the ground sets against sliding: a steady impulse [N s], and a drag [kg/m], see :func:`impulse`.

    Here that of a ground without friction; the ``resistance`` of a law stands in its place where kernels are compiled.
    """
    return real(0.0), real(0.0)


def limited_resistance(normal: Any, slip: Any, area: Any, dt: Any, basal: Any):
    """:func:`law_resistance` with a steady part that is at most what the mass above passes on, ``basal.strength`` [1]."""
    steady, drag = law_resistance(normal, slip, area, dt, basal)
    return min(steady, basal.strength * normal), drag


def steady_resistance(normal: Any, slip: Any, area: Any, dt: Any, basal: Any):
    """:func:`law_resistance` without its drag, which acts on the column instead."""
    steady, _ = law_resistance(normal, slip, area, dt, basal)
    return steady, real(0.0)


def slip_after(free: Any, resistance: Any):
    """Speed [m/s] that drag leaves: the root s >= 0 of s + resistance s^2 = free; ``resistance`` [s/m], both >= 0.

    Implicit, so that drag never reverses the motion, however long the step; written without cancellation.
    """
    return real(2.0) * free / (real(1.0) + math.sqrt(real(1.0) + real(4.0) * resistance * free))


def fastest_start(h: Any, gravity: Any, dt: Any):
    """Speed [m/s] up to which an impulse starts from the force of the step before, on a grid with the smallest spacing ``h`` [m].

    The force belongs to the weights of the step before. A particle that has moved on by a part of a cell would start from a wrong
    one: thin fast flows then break up. Laws with drag use this limit. It is not less than what ``gravity`` [m/s2] adds in a step:
    without that start a resting mass keeps some of it in each step, trembles faster than a lower limit, and never rests.
    """
    return max(real(STILL) * h / dt, gravity * dt)


def started_time(v: Any, fastest: Any, dt: Any):
    """Time [s] over which the force of the step before counts for a particle with velocity ``v``: ``dt``, 0 if it is too fast."""
    lasting = dt
    if dot(v, v) > fastest * fastest:
        lasting = real(0.0)
    return lasting


def kept_share(dt: Any, before: Any):
    """Share [1] of the force of a step of ``before`` [s] from which contacts start in a step of ``dt`` [s].

    An impulse also corrects what differs between the weights of two steps, which does not shrink with the step: the force of a very
    short step is as many times too large as the step is shorter than the next. So the impulse at the start is at most twice that of
    the step before. ``before`` is 0 if there was none.
    """
    share = real(1.0)
    if dt > real(2.0) * before and before > real(0.0):
        share = real(2.0) * before / dt
    return share


def largest_share(around: Any):
    """Largest reciprocal sum of weights that :func:`area_share` counts, from the mean of the sums ``around`` a contact."""
    return real(1.0) / (real(RIM) * around)


def area_share(weight: Any, inverse_sum: Any, largest: Any):
    """Share [1] of the ground below a column of nodes that a contact takes.

    That is its ``weight`` there (the product of those along east and north) over the sum of the weights of all contacts, which is
    given by its reciprocal. Inside a flow the shares of a column add up to one, so that the areas of all contacts add up to the
    wetted ground. A column beyond the rim, which contacts hardly reach, is not taken whole: ``largest`` is what the reciprocal
    may be, see :func:`largest_share`.
    """
    return weight * min(inverse_sum, largest)


def ground_area(plan_area: Any, shares: Any, upward: Any):
    """Area [m2] of inclined ground that a contact takes, from the area of a column in plan, its shares, and n_z of the normal."""
    return plan_area * shares / upward


def effective_impulse(u: Any, n: Any, gap: Any, compliance: Any, basal: Any, dt: Any, last_impulse: Any, area: Any, effective: Any):
    """Impulse [N s] of the ground on a particle in a step: unilateral, with friction on the whole tangential vector.

    One sweep of projected Jacobi iteration (Moreau and Jean 1996) that starts from the impulse ``last_impulse`` [N s], which the
    velocity ``u`` contains already; it is the force of the step before times dt. Lumped compliances correct what all
    neighbours share in one sweep and what differs between them in several, so that sweeps of a static load go on over the steps.

    Normal: u.n is brought to :func:`normal_target`; the total never pulls. Tangential: sticks if the steady impulse R of the law
    admits the total, else slides against R + drag dt s^2, where s is the speed that is left (:func:`slip_after`). ``basal`` are the
    numbers of the law; it takes the slip speed of ``u`` and the ground ``area`` [m2], 0 for a law that does not use it. Friction
    acts on the share ``effective`` [1] of the normal impulse, 1 without pore pressure (:mod:`runout.physics.pore_pressure`).
    """
    un = dot(u, n)
    last_normal = dot(last_impulse, n)
    normal = last_normal + (normal_target(un - compliance * last_normal, gap, dt) - un) / compliance
    if normal <= real(0.0):
        return vec(real(0.0), real(0.0), real(0.0))
    ux = u[0] - un * n[0]
    uy = u[1] - un * n[1]
    uz = u[2] - un * n[2]
    tx = last_impulse[0] - last_normal * n[0] - ux / compliance
    ty = last_impulse[1] - last_normal * n[1] - uy / compliance
    tz = last_impulse[2] - last_normal * n[2] - uz / compliance
    along = math.sqrt(tx * tx + ty * ty + tz * tz)
    steady, drag = law_resistance(effective * normal, math.sqrt(ux * ux + uy * uy + uz * uz), area, dt, basal)
    s = real(1.0)
    if along > steady:
        s = steady / along
        if drag > real(0.0):
            left = slip_after(compliance * (along - steady), compliance * drag * dt)
            s = (steady + drag * dt * left * left) / along
    return vec(normal * n[0] + s * tx, normal * n[1] + s * ty, normal * n[2] + s * tz)


def impulse(u: Any, n: Any, gap: Any, compliance: Any, basal: Any, dt: Any, last_impulse: Any, area: Any):
    """:func:`effective_impulse` of a mass without pore pressure."""
    return effective_impulse(u, n, gap, compliance, basal, dt, last_impulse, area, real(1.0))


def column_drag(push: Any, u: Any, n: Any, area: Any, compliance: Any, gravity: Any, dt: Any, basal: Any):
    """Drag [kg/m] by which a contact with the impulse ``push`` [N s] slows the columns of nodes around it.

    ``u`` is the velocity of the particle, as for :func:`impulse`. A contact that does not press in this step has the drag of its
    own weight, as mass in flight has (:func:`free_column_drag`); its mass is that which it shares with its neighbours, one over the
    ``compliance`` [1/kg]. The contacts of a transfer share the ground among them: without this a column whose contacts press in
    turns would have less drag than one that flies. ``gravity`` [m/s2] is the magnitude.
    """
    normal = dot(push, n)
    if normal <= real(0.0):
        normal = gravity * dt / compliance
    un = dot(u, n)
    slip = math.sqrt(max(real(0.0), dot(u, u) - un * un))
    _, drag = law_resistance(normal, slip, area, dt, basal)
    return drag


def covered_share(mass: Any, around: Any, squares: Any):
    """Share [1] of the ground below a column of nodes that the column covers, where no contact says it.

    ``around`` [kg] is the sum of the masses of the 3 x 3 columns around, ``squares`` [kg2] that of their squares, so that
    squares / around is the mass of a usual column there. A column that holds half of it is covered whole, one at the rim in
    proportion to its mass: its mass by area, and so its drag, is that of the flow beside it.
    """
    return min(real(1.0), real(2.0) * mass * around / squares)


def free_column_drag(mass: Any, momentum: Any, area: Any, gravity: Any, dt: Any, basal: Any):
    """Drag [kg/m] on a column of nodes that no contact slows, over an ``area`` [m2] in plan.

    Depth-averaged models, which state the drag, let no mass leave the ground. Mass in flight has the drag that it would have if
    it pressed on the ground with its own weight; ``gravity`` [m/s2] is the magnitude. It has no friction.
    """
    speed = math.sqrt(dot(momentum, momentum)) / mass
    _, drag = law_resistance(mass * gravity * dt, speed, area, dt, basal)
    return drag


def column_slowing(mass: Any, momentum: Any, drag: Any, dt: Any):
    """Change of velocity [m/s] of a column as a whole in a step, by the ``drag`` [kg/m] of all contacts below it.

    All of its ``mass`` [kg] is slowed alike, as depth-averaged models mean it: no shear has to pass through the mass. Implicit
    (:func:`slip_after`): the change is -(drag dt / mass) s^2 along the mean velocity, where s is the speed that is left.
    """
    speed = math.sqrt(dot(momentum, momentum)) / mass
    if speed <= real(0.0) or drag <= real(0.0):
        return vec(real(0.0), real(0.0), real(0.0))
    k = drag * dt / mass
    left = slip_after(speed, k)
    factor = -(k * left) * left / (speed * mass)
    return vec(factor * momentum[0], factor * momentum[1], factor * momentum[2])


def column_work(mass: Any, momentum: Any, change: Any):
    """Work [J] of a ``change`` of the velocity of a column: the change of its kinetic energy."""
    return dot(momentum, change) + real(0.5) * mass * dot(change, change)


def zone_friction(friction: Any, factor: Any, own: Any):
    """Friction coefficient [1] in a zone of the ground that multiplies that of the mass by ``factor`` and adds its ``own`` [1].

    A zone that replaces the friction of the mass has the factor 0, one that changes it the own coefficient 0; on the border of a
    zone both are means by area.
    """
    return factor * friction + own


def work(push: Any, last_impulse: Any, before: Any, u: Any, compliance: Any):
    """Work [J] of an impulse ``push``, with the mean of the particle's velocities before the step and after it.

    ``u`` is the velocity that it would have with the impulse ``last_impulse`` alone. Gravity, internal force and impulse act in
    one step; the mean over the whole step books none of the work that the ground does against forces that it cancels.
    """
    x = before[0] + u[0] + compliance * (push[0] - last_impulse[0])
    y = before[1] + u[1] + compliance * (push[1] - last_impulse[1])
    z = before[2] + u[2] + compliance * (push[2] - last_impulse[2])
    return real(0.5) * (push[0] * x + push[1] * y + push[2] * z)
