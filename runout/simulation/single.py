"""One scenario from its inputs to its result."""

import logging
import os
import time as clock
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from runout.backends.protocol import get_backend
from runout.forecast.accuracy import chosen_cell_size
from runout.forecast.memory import Extent, expected_memory, require_memory, with_births, with_inflow
from runout.model import basal_strength
from runout.model.basal_friction import USUAL_ANGLE, BasalFriction
from runout.model.bed import Bed
from runout.model.friction import FrictionZones
from runout.model.inflow import Inflow
from runout.model.limits import CFL
from runout.model.materials import Material
from runout.model.numerics import Numerics
from runout.model.pore_pressure import doubts
from runout.model.probes import Probes
from runout.model.release import Release
from runout.model.release_start import require_starts
from runout.model.scene import Scene
from runout.model.structures import StructureField, Structures
from runout.model.terrain import Terrain
from runout.release.inlet import mass_at
from runout.simulation.checkpoint import EVERY, checkpoint_for, run_key
from runout.simulation.entering import Entering, Source
from runout.simulation.erosion import eroding_bed
from runout.simulation.inflow import record_of, sources_of
from runout.simulation.result import Result
from runout.simulation.run import Run, RunControl
from runout.simulation.scenario import build_scene, inflows_of
from runout.simulation.structure_forces import named_structures
from runout.simulation.waiting_release import WaitingRelease

LOGGER = logging.getLogger(__name__)


def simulate(
    terrain: Terrain,
    release: Release | Sequence[Release],
    material: Material,
    *,
    basal_friction_angle: float = USUAL_ANGLE,
    basal_friction: BasalFriction | None = None,
    friction_zones: FrictionZones | None = None,
    structures: Structures | StructureField | None = None,
    bed: Bed | None = None,
    inflow: Inflow | Sequence[Inflow] = (),
    bulking: float = 1.0,
    cell_size: float | tuple[float, float, float] | None = None,
    particles_per_cell: int | tuple[int, int, int] | None = None,
    end_time: float,
    backend: str = "scan",
    device: str = "cpu",
    precision: str = "float32",
    seed: int = 0,
    cfl: float = CFL,
    substeps: int = 4,
    initial_stress: str = "at_rest",
    accuracy: str | None = None,
    threads: int | None = None,
    stop: bool = True,
    arrival_threshold: float = 0.1,
    snapshot_times: Sequence[float] = (),
    snapshot_particles: int = 0,
    force_interval: float | None = None,
    joint_conditions: Sequence[Mapping[str, float]] = (),
    probes: Probes | None = None,
    progress: Callable[[float], None] | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
    checkpoint_every: float = EVERY,
    memory_gb: float | None = None,
) -> Result:
    """Run one scenario.

    Parameters
    ----------
    terrain : Terrain
    release : Release or sequence of Release
        The masses that start to move; several must not overlap. Empty where an inflow is all there is.
    material : Material
        Material of every release without a material of its own.
    basal_friction_angle : float
        Coulomb friction angle at the ground [deg], 0 to 60, for every release without an angle of its own.
    basal_friction : BasalFriction, optional
        Law of friction at the ground and its parameters, instead of that angle.
    friction_zones : FrictionZones, optional
        Zones where the ground multiplies or replaces the friction, see :meth:`runout.FrictionZones.from_vector`.
    structures : Structures or StructureField, optional
        Buildings, walls, dams or galleries that the flow meets; the forces on them are ``Result.structure_forces``.
    bed : Bed, optional
        Erodible bed on the ground, which the flow takes up at the rate of a law.
    inflow : Inflow or sequence of Inflow
        Mass that enters at lines or over polygons while the run goes on; then ``release`` may be empty.
    bulking : float
        Volume of the deposit over that of its mass without stress [1], 0.1 to 10: multiplies the thickness of the deposit.
    cell_size : float or (dx, dy, dz)
        Grid spacing [m]; required without ``accuracy``.
    particles_per_cell : int or (nx, ny, nz)
        Particles per cell; 8 is (2, 2, 2). Default: (2, 2, 4), or (3, 3, 1) for a mass at least five cells thick on level
        ground (:mod:`runout.release.arrangement`).
    end_time : float
        Latest time [s].
    backend, device : str
        "scan" (CPU, numba), "hash" (warp: "cuda:0", or "cpu", slow), "auto" (hash if there is a GPU, else scan) or
        "reference" (NumPy, slow).
    precision : str
        "float32" or "float64".
    seed : int
        Seed of the positions of the particles.
    cfl : float
        Courant number; 0.6 by default, which is also the largest. A smaller value is not more accurate, since each step damps.
    substeps : int
        Most substeps of a transfer between particles and grid, 1 to 64: forces and contacts are taken anew in each, the transfer,
        which damps, is made once (:mod:`runout.physics.substeps`).
    initial_stress : str
        "at_rest": releases start with the stress of their own weight, as on an infinite slope; "none": without stress.
    accuracy : str, optional
        "screening", "standard" or "high": the cell_size that follows from the mean thickness of the release
        (:data:`runout.forecast.accuracy.PRESETS`); an explicit cell_size overrides it.
    threads : int, optional
        Threads of the CPU; all by default. The result does not depend on it.
    stop : bool
        Stop when the flow has come to rest.
    arrival_threshold : float
        Thickness from which a cell counts as reached [m].
    snapshot_times : sequence of float
        Times [s] at which maps of thickness and speed are stored, interpolated between two steps; they change no step.
    snapshot_particles : int
        Most particles whose positions and speeds are stored at these times, evenly chosen; 0: none.
    force_interval : float, optional
        Least time between two records of the forces on structures [s]; a 200th of ``end_time`` by default, 0 for every step.
    joint_conditions : sequence of mapping of str to float
        Thresholds of two or more quantities each, such as ``{"thickness": 1.0, "speed": 2.0}`` in m and m/s, or the strength of a
        house, ``{"house_force": 35.3e3, "house_height": 5.6}`` in N and m; at most 24. The map ``met_at_one_time`` has bit k where
        the flow reached all thresholds of condition k at one time.
    probes : Probes, optional
        Points and cross-sections, in map coordinates, whose time series :attr:`runout.Result.probes` holds.
    progress : callable, optional
        Called with the fraction of the simulated time, 0 to 1.
    checkpoint : path, optional
        Checkpoint file. If a run was interrupted, the same call continues from it and gives the same bits. Removed at the end.
    checkpoint_every : float
        Wall time between two checkpoints [s].
    memory_gb : float, optional
        Limit of the memory [GB]. A run with a larger forecast is refused, as is one that exceeds the available memory.

    Raises
    ------
    DemError, ReleaseError, MaterialError, ConfigError
        If an input cannot be used; the message names place, value and remedy.
    StabilityError, CapacityError, DeviceError
        If a run cannot continue.
    """
    started = clock.perf_counter()
    control = RunControl(
        end_time, stop, arrival_threshold, tuple(sorted(snapshot_times)), force_interval=force_interval,
        snapshot_particles=snapshot_particles, probes=probes.on(terrain) if probes else None, bulking=bulking,
        joint_conditions=joint_conditions,
    )  # fmt: skip
    named, engine = named_structures(structures), get_backend(backend, device, threads)
    releases = [release] if isinstance(release, Release) else list(release)
    require_starts(releases, end_time)
    inflows, masses = inflows_of(inflow), [*releases, *map(mass_at, inflows_of(inflow))]
    size: Any = chosen_cell_size(accuracy, masses, cell_size)
    numerics = Numerics(
        cell_size=size, cfl=cfl, particles_per_cell=particles_per_cell, precision=precision, seed=seed, substeps=substeps,
        initial_stress=initial_stress,
    )  # fmt: skip

    def accept(extent: Extent) -> None:
        born = with_births(extent, bed, masses, numerics, basal_friction or basal_friction_angle)
        whole, cells, record = with_inflow(born, inflows, numerics, end_time), terrain.elevation.size, len(joint_conditions)
        require_memory(expected_memory(whole, cells, numerics, engine, named, basal_friction, conditions=record), engine, memory_gb)

    waiting: list[WaitingRelease] = []
    scene, particles = build_scene(
        terrain, releases, material, basal_friction_angle, numerics, basal_friction=basal_friction, friction_zones=friction_zones,
        structures=named, inflow=inflows, bed=bed, accept=accept, in_chunks=True, waiting=waiting,
    )  # fmt: skip
    _warn(scene, [r.name for r in masses], inflows, end_time)
    eroding = eroding_bed(bed, scene, terrain, releases, particles.how.per_axis, masses[len(releases) :])
    sources: list[Source] = [*waiting, *sources_of(inflows, len(releases), scene.spacing, particles.how.per_axis, end_time, seed)]
    entering = Entering(sources) if sources else None
    more = [part for part in (eroding, entering) if part]
    key = run_key(scene, particles, control, type(engine).__name__, more=more) if checkpoint else ""
    keep = checkpoint_for(checkpoint, checkpoint_every, engine, key)
    run = Run(engine, scene, control, progress, keep, named, eroding, entering)
    run.start(particles)
    del particles
    result = _computed(run, terrain, clock.perf_counter() - started)
    if keep:
        keep.remove()
    return result


def _computed(run: Run, terrain: Terrain, setup: float) -> Result:
    """Result of a run that is loaded, after ``setup`` [s] of preparation; what a user should know of it is logged."""
    loaded = clock.perf_counter()
    run.go()
    run.seconds += clock.perf_counter() - loaded
    result = run.result(terrain, run.n_particles, setup)
    result.start = {**result.start, **record_of(run.entering.sources if run.entering else ())}
    for name in result.never_started:
        LOGGER.warning("release %s never started: the flow that it waits for did not arrive; its mass is never released", name)
    if result.depth_resolution.is_coarse:
        LOGGER.warning("%s", result.depth_resolution.warning())
    return result


def _warn(scene: Scene, names: Sequence[str], inflows: Sequence[Inflow], end_time: float) -> None:
    """Log what a user should know of masses, by their ``names``: friction that acts or not, pore pressure, what stays out."""
    of_inflows = (sentence for one in inflows for sentence in one.sentences(end_time, scene.spacing))
    unchanged = basal_strength.unchanged(scene.friction, names, scene.friction_zones)
    doubted = doubts(scene.pore_pressure, scene.densities, names)
    for sentence in (*basal_strength.sentences(scene, names), *unchanged, *doubted, *of_inflows):
        LOGGER.warning("%s", sentence)
