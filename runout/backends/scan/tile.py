"""A tile of 32 particles: a row for each number, a column for each particle, so that loops over columns run in vector lanes.

       rows  0 .. 15  record            24  code of the move           28  refused move
            16 .. 23  state             25  speed squared              29  large strain
            31 .. 46  sums              26  largest move [cells]       30  whether the column holds a particle
            47  effective share         27  dissipated energy
            48  release, of several with pore pressure

The effective share is that of the normal stress which grains carry. Sums are those of velocities and moments over the substeps of
a transfer (:mod:`runout.backends.scan.substep`).
"""

from runout.backends.lanes import local_array, record_vectors, row_vectors
from runout.physics.moments import moment_about, momentum_at, velocity_gradient
from runout.physics.substeps import force_columns, inverse_deformation, stress_at_start
from runout.physics.tensors import real, vec

TILE = 32
# rows of a tile after the 16 numbers of the record and the 8 of the state
CODE, SPEED, MOVE, LOST, REFUSED, LARGE, ALIVE = 24, 25, 26, 27, 28, 29, 30
SUMS = 31  # first of the 16 rows of sums, where SEVERAL is set
EFFECTIVE, RELEASES = SUMS + 16, SUMS + 17  # share of the normal stress that grains carry, where WET is set
local_tile = local_array((RELEASES + 1, TILE))
load_records, store_records = record_vectors(16)
load_states, store_states = record_vectors(8)
load_16_rows, store_16_rows = row_vectors(16, TILE)
load_8_rows, store_8_rows = row_vectors(8, TILE)


def _about_particles(r):
    """A gathered record whose first moments about the first node are replaced by those about the particle; numbers or lanes."""
    v = (r[1], r[2], r[3])
    x = moment_about(vec(r[5], r[6], r[7]), r[4], v)
    y = moment_about(vec(r[9], r[10], r[11]), r[8], v)
    z = moment_about(vec(r[13], r[14], r[15]), r[12], v)
    return (r[0], *v, r[4], *x, r[8], *y, r[12], *z)


def _load_tile(t, rec, k, state, p, groups):
    """Transpose records from place ``k`` on, and states from place ``p`` on, into the columns of a tile."""
    for g in range(groups):
        store_16_rows(t, 16 * g, _about_particles(load_records(rec, 16 * (k + 16 * g))))
        store_8_rows(t, 16 * TILE + 16 * g, load_states(state, 8 * (p + 16 * g)))


def _load_sums(t, rec, p, groups):
    """Transpose the sums over the substeps, which the records from slot ``p`` on hold."""
    for g in range(groups):
        store_16_rows(t, SUMS * TILE + 16 * g, _about_particles(load_records(rec, 16 * (p + 16 * g))))


def _clear_sums(t, groups):
    """Set the sums to 0: those before the only substep of a transfer."""
    for k in range(16):
        for p in range(16 * groups):
            t[SUMS + k, p] = real(0.0)


def _store_tile(t, rec, k, state, p, groups):
    for g in range(groups):
        store_records(rec, 16 * (k + 16 * g), load_16_rows(t, 16 * g))
        store_states(state, 8 * (p + 16 * g), load_8_rows(t, 16 * TILE + 16 * g))


def _rows(t, p, k):
    """Three rows of a column from row ``k`` on."""
    return vec(t[k, p], t[k + 1, p], t[k + 2, p])


def _moments(t, p):
    """Columns of first moments [m/s] of a column of a tile."""
    return _rows(t, p, 5), _rows(t, p, 9), _rows(t, p, 13)


def _way_gradient(t, p, s):
    """Gradient [1] of the way since the start of the transfer, from the sums of a column."""
    return velocity_gradient(_rows(t, p, SUMS + 5), _rows(t, p, SUMS + 9), _rows(t, p, SUMS + 13), s)


def _sums_before(t, p, k):
    """Three sums of a column from row ``k`` of the record on, without what the last substep has added."""
    return vec(t[SUMS + k, p] - t[k, p], t[SUMS + k + 1, p] - t[k + 1, p], t[SUMS + k + 2, p] - t[k + 2, p])


def _way_before(t, p, s):
    """The same before the last substep."""
    return velocity_gradient(_sums_before(t, p, 5), _sums_before(t, p, 9), _sums_before(t, p, 13), s)


def _stay_on_grid(t, p, tau, s):
    """Replace velocity and moments of a column, which its sums contain, by the impulse of its internal force."""
    at_start = stress_at_start(tau, inverse_deformation(_way_gradient(t, p, s)))
    f = force_columns(at_start, t[23, p], s)
    ax = vec(f[0], f[1], f[2])
    ay = vec(f[3], f[4], f[5])
    az = vec(f[6], f[7], f[8])
    nothing = vec(real(0.0), real(0.0), real(0.0))
    to_node = vec(real(1.0) - t[4, p], real(1.0) - t[8, p], real(1.0) - t[12, p])
    t[1, p], t[2, p], t[3, p] = momentum_at(nothing, ax, ay, az, to_node)
    t[5, p], t[6, p], t[7, p] = ax
    t[9, p], t[10, p], t[11, p] = ay
    t[13, p], t[14, p], t[15, p] = az
