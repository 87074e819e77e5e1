"""One case per function of physics: the kinds of its arguments and results, and random arguments in its range.

Kinds: ``s`` real, ``v`` vector, ``y`` symmetric tensor, ``t`` tensor, ``i`` 32-bit integer, ``k`` 63-bit key, ``b`` truth,
``m`` record of parameters of a material or of friction.
"""

from collections.abc import Callable
from dataclasses import dataclass
from types import FunctionType

import numpy as np

from runout.model.basal_friction import MassAbove
from runout.model.friction_laws import FrictionLaw
from runout.model.laws import Law
from runout.physics import (
    bed,
    blocks,
    bspline,
    contact,
    elastic,
    flow_columns,
    geostatic,
    heightfield,
    inflow,
    moments,
    numerical_scales,
    plastic,
    pore_pressure,
    several_laws,
    structures,
    substeps,
    tensors,
    timestep,
)

LENGTH = {"s": 1, "v": 3, "y": 6, "t": 9, "i": 1, "k": 1, "b": 1}
PORES = {"equilibrium": 0.4, "closure": 1.27, "decay_rate": 0.1, "diffusion": 0.05}
MATERIAL = {"lame_lambda": 2.9e6, "shear_modulus": 1.9e6, "strength": 0.5, "law_number": 0.0, **PORES}
MASS = MassAbove(0.5, 2000.0, 9.81)
TIME_STEP = 1e-3
SINGLE_PRECISION_OF_A_LAW = 3e-5  # strains a hundred times beyond yield leave a small difference of large numbers
Sampler = Callable[[np.random.Generator, int], np.ndarray]


@dataclass(frozen=True)
class Case:
    function: FunctionType
    arguments: str
    results: str
    samplers: tuple[Sampler, ...]
    single_precision: float = 1e-6  # difference from float64, relative to the largest result
    law: Law | FrictionLaw | None = None  # whose function it is
    part: int = 0  # of a mixture: the law whose record it takes

    @property
    def name(self) -> str:
        home = home_of(self.law) if self.law else self.function.__module__.rsplit(".", 1)[-1]
        return f"{home}_{self.function.__name__}"

    @property
    def material(self) -> dict[str, float]:
        """Record of parameters."""
        law = self.law.laws[self.part] if self.law else None
        if isinstance(law, FrictionLaw):
            record = {name: float(value) for name, value in law.friction.acting(law.example.numbers(), MASS).items()}
        else:
            record = law.example.record() if law else MATERIAL
        if self.law and len(self.law.laws) > 1:
            record = {name: record.get(name, 0.0) for name in self.law.fields} | {"law_number": float(self.part)}
        return {**record, "time_step": TIME_STEP} if "time_step" in record else record

    def sample(self, n: int = 400, seed: int = 3) -> list[np.ndarray]:
        """Arguments (n, length) without the material record."""
        rng = np.random.default_rng(seed)
        return [draw(rng, n).reshape(n, -1) for draw in self.samplers]


def home_of(law: Law | FrictionLaw) -> str:
    """Name of a law among those of both kinds."""
    return f"friction_{law.name}" if isinstance(law, FrictionLaw) else law.name


def between(low: float, high: float, length: int = 1) -> Sampler:
    return lambda rng, n: rng.uniform(low, high, (n, length))


def outside_of(low: float, high: float) -> Sampler:
    """Numbers from 0 to ``low`` and from ``high`` to its double."""
    return lambda rng, n: np.where(rng.random((n, 1)) < 0.5, rng.uniform(0, low, (n, 1)), rng.uniform(high, 2 * high, (n, 1)))


def whole(low: int, high: int) -> Sampler:
    return lambda rng, n: rng.integers(low, high, (n, 1), endpoint=True)


def spread(size: float, length: int) -> Sampler:
    """Normal numbers whose size varies over four decades up to ``size``."""
    return lambda rng, n: rng.normal(0.0, 1.0, (n, length)) * size * 10.0 ** rng.uniform(-4, 0, (n, 1))


def positive_definite(rng: np.random.Generator, n: int) -> np.ndarray:
    """Symmetric tensors with eigenvalues of 0.2 to 5."""
    q = np.linalg.qr(rng.normal(size=(n, 3, 3)))[0]
    a = np.einsum("pij,pj,pkj->pik", q, np.exp(rng.uniform(-1.6, 1.6, (n, 3))), q)
    return np.stack([a[:, 0, 0], a[:, 1, 1], a[:, 2, 2], a[:, 0, 1], a[:, 1, 2], a[:, 2, 0]], axis=1)


def stretched(rng: np.random.Generator, n: int) -> np.ndarray:
    """B = b - I of large strains."""
    return positive_definite(rng, n) - np.array([1, 1, 1, 0, 0, 0])


def of_any_size(rng: np.random.Generator, n: int) -> np.ndarray:
    """B of strains that the series serve, and of larger ones."""
    return np.concatenate([served(rng, n // 2), stretched(rng, n - n // 2)])


def loaded(rng: np.random.Generator, n: int) -> np.ndarray:
    """B of mostly compressed material: elastic, on the cone and beyond the apex."""
    return spread(0.01, 6)(rng, n) + np.array([1, 1, 1, 0, 0, 0]) * rng.uniform(-0.02, 0.002, (n, 1))


def remembered(rng: np.random.Generator, n: int) -> np.ndarray:
    """Log volume gained at the apex, none for half of the material."""
    return np.maximum(rng.uniform(-0.02, 0.02, (n, 1)), 0.0)


def unit_vector(rng: np.random.Generator, n: int) -> np.ndarray:
    v = rng.normal(size=(n, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def key(rng: np.random.Generator, n: int) -> np.ndarray:
    return np.array([[blocks.block_key(*map(int, xyz))] for xyz in rng.integers(-(2**20), 2**20, (n, 3))])


angle, number, tensor, node = between(0.0, 1.0), between(-3.0, 3.0), between(-3.0, 3.0, 6), whole(-(2**30), 2**30)
vector, strain, modulus, ratio = between(-3.0, 3.0, 3), spread(0.005, 6), between(1e5, 1e8), between(0.0, 0.45)
served = spread(0.1, 6)  # by the series, nearly all
rate = spread(0.005, 9)
step, speed, block = between(1e-4, 1e-2), between(0.0, 50.0), whole(-(2**20), 2**20 - 1)

area, share = between(0.1, 4.0), between(0.03, 1.0)
IN_LATTICE_CELL = (between(0.0, 1.0),) * 3
OF_A_CONTACT = (vector, unit_vector, between(-0.01, 0.02), between(1e-3, 1e-2), between(0.01, 0.1), vector, area)

CASES = [
    Case(tensors.dot, "vv", "s", (vector, vector)),
    Case(tensors.trace, "y", "s", (tensor,)),
    Case(tensors.isotropic, "s", "y", (number,)),
    Case(tensors.shifted, "ys", "y", (tensor, number)),
    Case(tensors.scaled, "ys", "y", (tensor, number)),
    Case(tensors.added, "yy", "y", (tensor, tensor)),
    Case(tensors.contracted, "yy", "s", (tensor, tensor)),
    Case(tensors.norm, "y", "s", (tensor,)),
    Case(tensors.deviator, "y", "y", (tensor,)),
    Case(tensors.product, "yy", "y", (tensor, tensor)),
    Case(tensors.inverse, "y", "y", (positive_definite,)),
    Case(tensors.invariants, "y", "v", (tensor,)),
    Case(tensors.horner, "vvs", "v", (vector, vector, number)),
    Case(tensors.squared_invariants, "v", "v", (vector,)),
    Case(tensors.interlaced, "vvv", "v", (vector, vector, vector)),
    Case(tensors.polynomial, "yv", "y", (tensor, vector)),
    Case(elastic.lame_lambda, "ss", "s", (modulus, ratio)),
    Case(elastic.shear_modulus, "ss", "s", (modulus, ratio)),
    Case(elastic.wave_speed, "sss", "s", (modulus, modulus, between(500, 3000))),
    Case(elastic.youngs_modulus, "sss", "s", (between(5, 1000), between(500, 3000), ratio)),
    Case(elastic.trial_strain, "yt", "y", (strain, rate)),
    Case(elastic.log_strain_series, "y", "y", (served,)),
    Case(elastic.square_root, "y", "y", (positive_definite,)),
    Case(elastic.log_strain_scaled, "y", "y", (stretched,), 1e-5),
    Case(elastic.log_strain, "y", "y", (of_any_size,), 1e-5),
    Case(elastic.strain_series, "y", "y", (served,)),
    Case(elastic.strain_of_log, "y", "y", (spread(0.5, 6),)),
    Case(elastic.strain_scaled, "y", "y", (spread(0.5, 6),)),
    Case(elastic.kirchhoff_stress, "ym", "y", (strain,)),
    Case(elastic.strain_of_stress, "ym", "y", (spread(1e4, 6),)),
    Case(elastic.energy_density, "ym", "s", (strain,)),
    Case(elastic.pressure, "ym", "s", (strain,)),
    Case(elastic.deviatoric_stress, "ym", "s", (strain,)),
    Case(elastic.step, "ytsm", "yyss", (strain, rate, ratio)),
    Case(elastic.vanishes, "s", "b", (whole(0, 1),)),
    Case(elastic.is_small, "s", "b", (outside_of(0.0783, 0.0785),)),
    Case(elastic.step_small, "ytsm", "yysss", (strain, rate, ratio)),
    Case(plastic.same, "yy", "b", (strain, strain)),
    Case(plastic.gained_volume, "yy", "s", (strain, strain)),
    Case(plastic.dissipated_energy, "yym", "s", (strain, strain)),
    Case(plastic.end_of_step, "yyyss", "yyss", (strain, strain, strain, remembered, number)),
    Case(plastic.end_of_small_step, "yyyss", "yysss", (strain, strain, strain, remembered, number)),
    Case(plastic.law_return, "ysm", "yss", (strain, remembered)),
    Case(plastic.step, "ytsm", "yyss", (strain, rate, remembered)),
    Case(plastic.step_small, "ytsm", "yysss", (strain, rate, remembered)),
    Case(plastic.history_share, "ss", "s", (number, share)),
    Case(plastic.volume_share, "ss", "s", (between(-1.0, 1.0), share)),
    Case(plastic.with_trace, "ys", "y", (strain, share)),
    Case(plastic.effective_return, "ysms", "yss", (strain, remembered, share)),
    Case(plastic.dry_return, "ysm", "yss", (strain, remembered)),
    Case(plastic.effective_step, "ytsms", "yyss", (strain, rate, remembered, share)),
    Case(plastic.effective_step_small, "ytsms", "yysss", (strain, rate, remembered, share)),
    Case(pore_pressure.equilibrium_ratio, "ss", "s", (share, between(500, 3000))),
    Case(pore_pressure.diffusion_rate, "s", "s", (step,)),
    Case(pore_pressure.layer_thickness, "ssss", "s", (between(0.1, 50.0), area, between(500, 3000), share)),
    Case(pore_pressure.drainage_rate, "sm", "s", (area,)),
    Case(pore_pressure.share_left, "ss", "s", (between(0.0, 2.0), step)),
    Case(pore_pressure.remaining_share, "ssm", "s", (area, step)),
    Case(pore_pressure.pore_ratio, "ssm", "s", (between(-0.4, 0.5), share)),
    Case(pore_pressure.effective_share, "ssm", "s", (between(-0.4, 0.5), share)),
    Case(pore_pressure.effective_friction, "ss", "s", (angle, share)),
    Case(pore_pressure.total_lateral_ratio, "ss", "s", (angle, share)),
    Case(geostatic.at_rest, "s", "s", (angle,)),
    Case(geostatic.shear_strength, "ss", "s", (angle, modulus)),
    Case(geostatic.acting_friction, "ss", "s", (angle, angle)),
    Case(geostatic.mobilised_share, "ss", "s", (angle, angle)),
    Case(geostatic.lateral_ratio, "ssss", "s", (angle, between(0.0, 0.4), between(0.7, 1.7), between(0.0, 0.1))),
    Case(geostatic.strain_at_rest, "ssssssssm", "y", (modulus, number, number, angle, angle, between(0.7, 1.7), modulus, angle)),
    Case(geostatic.slope_stress, "sssss", "y", (modulus, number, number, angle, angle)),
    Case(contact.in_contact, "ssss", "b", (between(-0.1, 0.1), between(-5.0, 5.0), step, between(0.001, 0.02))),
    Case(contact.normal_target, "sss", "s", (between(-5.0, 5.0), between(-0.1, 0.1), between(1e-3, 1e-2))),
    Case(contact.law_resistance, "ssssm", "ss", (between(0.0, 5.0), speed, area, step)),
    Case(several_laws.own_return, "ysm", "yss", (strain, remembered)),
    Case(several_laws.own_effective_return, "ysms", "yss", (strain, remembered, share)),
    Case(several_laws.own_resistance, "ssssm", "ss", (between(0.0, 5.0), speed, area, step)),
    Case(contact.limited_resistance, "ssssm", "ss", (between(0.0, 5.0), speed, area, step)),
    Case(contact.steady_resistance, "ssssm", "ss", (between(0.0, 5.0), speed, area, step)),
    Case(contact.column_drag, "vvvssssm", "s", (vector, vector, vector, area, between(0.01, 5.0), between(1.0, 10.0), step)),
    Case(contact.covered_share, "sss", "s", (between(0.1, 50.0), between(50.0, 300.0), between(100.0, 4000.0))),
    Case(contact.free_column_drag, "svsssm", "s", (between(0.1, 50.0), vector, area, between(1.0, 10.0), step)),
    Case(contact.column_slowing, "svss", "v", (between(0.1, 50.0), vector, between(0.0, 50.0), step)),
    Case(contact.column_work, "svv", "s", (between(0.1, 50.0), vector, vector)),
    Case(contact.fastest_start, "sss", "s", (between(0.1, 5.0), between(0.0, 10.0), step)),
    Case(contact.started_time, "vss", "s", (vector, between(0.01, 5.0), step)),
    Case(contact.kept_share, "ss", "s", (step, between(1e-6, 0.1))),
    Case(bed.normal_stress, "ssvv", "s", (between(500.0, 2500.0), between(0.1, 5.0), vector, vector)),
    Case(bed.driving_stress, "ssvv", "s", (between(500.0, 2500.0), between(0.1, 5.0), vector, vector)),
    Case(bed.friction_stress, "sssm", "s", (between(0.0, 5.0), share, speed)),
    Case(inflow.push_of_flow, "ssss", "s", (speed, between(1.0, 10.0), between(0.1, 5.0), share)),
    Case(bed.time_to_travel, "sss", "s", (between(0.1, 5.0), speed, between(1.0, 10.0))),
    Case(bed.sunk, "ssss", "s", (between(0.0, 1.0), between(0.0, 0.1), between(0.1, 0.5), between(0.0, 1.0))),
    Case(bed.chance_at, "sss", "s", (between(0.0, 0.01), between(0.0, 0.01), between(0.0, 0.1))),
    Case(contact.largest_share, "s", "s", (between(0.05, 5.0),)),
    Case(contact.area_share, "sss", "s", (between(0.0, 1.0), between(0.1, 50.0), between(0.1, 50.0))),
    Case(contact.ground_area, "sss", "s", (between(0.1, 50.0), between(0.1, 4.0), between(0.2, 1.0))),
    Case(contact.slip_after, "ss", "s", (speed, between(0.0, 10.0))),
    Case(contact.impulse, "vvssmsvs", "v", OF_A_CONTACT),
    Case(contact.effective_impulse, "vvssmsvss", "v", (*OF_A_CONTACT, share)),
    Case(contact.approach_speed, "vssss", "s", (vector, number, number, step, step)),
    Case(contact.reach, "ssss", "s", (between(0.1, 2.0), speed, step, between(0.001, 0.02))),
    Case(contact.zone_friction, "sss", "s", (angle, angle, angle)),
    Case(contact.work, "vvvvs", "s", (vector, vector, vector, vector, between(0.01, 0.1))),
    Case(bspline.first_node, "s", "i", (between(-50.0, 50.0),)),
    Case(bspline.weights, "s", "v", (between(0.5, 1.5),)),
    Case(bspline.weight_slopes, "s", "v", (between(0.5, 1.5),)),
    Case(bspline.inverse_inertia, "s", "s", (between(0.1, 50.0),)),
    Case(moments.moment_slope, "ss", "s", (step, between(0.1, 50.0))),
    Case(moments.velocity_gradient, "vvvv", "t", (vector, vector, vector, vector)),
    Case(moments.moment_about, "vsv", "v", (vector, number, vector)),
    Case(moments.affine_at, "ssssv", "s", (number, number, number, number, vector)),
    Case(moments.momentum_at, "vvvvv", "v", (vector, vector, vector, vector, vector)),
    Case(moments.stress_columns, "ysv", "t", (tensor, between(0.1, 50.0), vector)),
    Case(moments.affine_columns, "svvv", "t", (between(0.1, 50.0), vector, vector, vector)),
    Case(moments.gradient_column, "sss", "s", (number, between(0.1, 50.0), between(0.1, 50.0))),
    Case(moments.node_velocity, "sss", "s", (number, between(0.1, 50.0), number)),
    Case(moments.velocity_after, "sss", "s", (number, number, between(0.1, 50.0))),
    Case(moments.kinetic_energy, "svvvv", "s", (between(0.1, 50.0), vector, vector, vector, vector)),
    Case(moments.potential_energy, "svv", "s", (between(0.1, 50.0), vector, vector)),
    Case(heightfield.weight_of_means, "s", "s", (between(1.0, 50.0),)),
    Case(heightfield.second_difference, "sss", "s", (number, number, number)),
    Case(heightfield.smoothness, "sssss", "s", (number, number, number, number, number)),
    Case(heightfield.smooth_coefficient, "ssss", "s", (number, number, number, between(0.25, 0.5))),
    Case(heightfield.spline_coefficient, "sssss", "s", (number, number, number, angle, between(0.25, 0.5))),
    Case(heightfield.bend_smoothness, "sssss", "s", (number, number, number, number, number)),
    Case(heightfield.resampled_coefficient, "ssss", "s", (number, number, number, angle)),
    Case(heightfield.interpolate, "vsss", "s", (vector, number, number, number)),
    Case(heightfield.normal_z, "ss", "s", (number, number)),
    Case(heightfield.surface_at, "tss", "v", (between(-3.0, 3.0, 9), between(0.5, 1.5), between(0.5, 1.5))),
    Case(heightfield.upward_normal, "ss", "v", (number, number)),
    Case(heightfield.distance, "ss", "s", (number, angle)),
    Case(heightfield.height_at, "ss", "s", (number, angle)),
    Case(structures.lattice_block, "i", "i", (node,)),
    Case(structures.lattice_place, "iii", "i", (node, node, node)),
    Case(structures.nearest_place, "isss", "i", (whole(0, 637), *IN_LATTICE_CELL)),
    Case(structures.between, "sss", "s", (number, number, between(0.0, 1.0))),
    Case(structures.separation, "tsss", "s", (between(-3.0, 3.0, 9), *IN_LATTICE_CELL)),
    Case(structures.separation_slopes, "tsss", "v", (between(-3.0, 3.0, 9), *IN_LATTICE_CELL)),
    Case(structures.outward_normal, "v", "v", (vector,)),
    Case(structures.is_closer, "sss", "b", (number, number, between(0.1, 1.0))),
    Case(structures.faces_more, "ss", "b", (number, number)),
    Case(structures.contact_gap, "ss", "s", (number, between(0.01, 1.0))),
    Case(structures.entry_velocity, "sss", "s", (number, *(between(0.01, 1.0),) * 2)),
    Case(structures.stopping_impulse, "sss", "s", (number, number, between(0.01, 1.0))),
    Case(substeps.longest_transfer, "sss", "s", (speed, between(1.0, 20.0), between(0.1, 50.0))),
    Case(substeps.is_slow, "sss", "b", (speed, step, between(0.1, 50.0))),
    Case(substeps.inverse_deformation, "t", "t", (between(-0.3, 0.3, 9),)),
    Case(substeps.present_gradient, "tt", "t", (rate, between(-1.5, 1.5, 9))),
    Case(substeps.stress_at_start, "yt", "t", (tensor, between(-1.5, 1.5, 9))),
    Case(substeps.force_columns, "tsv", "t", (between(-3.0, 3.0, 9), between(0.1, 50.0), vector)),
    Case(substeps.time_ahead, "ss", "s", (step, step)),
    Case(substeps.moved_gap, "svv", "s", (number, vector, vector)),
    Case(blocks.block_of, "i", "i", (node,)),
    Case(blocks.local_index, "iii", "i", (node, node, node)),
    Case(blocks.block_key, "iii", "k", (block, block, block)),
    Case(blocks.key_x, "k", "k", (key,)),
    Case(blocks.key_y, "k", "k", (key,)),
    Case(blocks.key_z, "k", "k", (key,)),
    Case(blocks.mixed, "k", "k", (key,)),
    Case(numerical_scales.numerical_viscosity, "sss", "s", (between(0.1, 50.0), between(1.0, 300.0), step)),
    Case(numerical_scales.decay_time, "ss", "s", (between(0.1, 50.0), between(1.0, 300.0))),
    Case(
        numerical_scales.artificial_wave_speed,
        "sssss",
        "s",
        (between(3, 20), between(0, 100), between(1, 20), between(0.1, 100), between(1e-3, 0.03)),
    ),
    Case(numerical_scales.shear_wave_length, "s", "s", (between(0.1, 50.0),)),
    Case(numerical_scales.footprint_area, "sss", "s", (between(0.1, 10.0), between(2.0, 16.0), between(4.0, 22.0))),
    Case(numerical_scales.covered_part, "ss", "s", (between(0.0, 2.0), between(1.0, 3.0))),
    Case(numerical_scales.neighbourhood, "s", "s", (between(0.0, 9.0),)),
    Case(numerical_scales.flowing_part, "ss", "s", (between(0.0, 2.0), between(2.0, 9.0))),
    Case(numerical_scales.least_thickness, "sss", "s", (between(0.1, 9.0), between(1.0, 50.0), between(2.0, 9.0))),
    Case(numerical_scales.smoothed_area, "s", "s", (between(0.5, 5.0),)),
    Case(numerical_scales.part_beyond, "sss", "s", (between(0.5, 8.0), between(1.0, 3.0), between(3.5, 8.0))),
    Case(numerical_scales.extent_count, "ss", "s", (between(0.0, 50.0), between(1.0, 3.0))),
    Case(
        numerical_scales.extent_parts,
        "ssssss",
        "v",
        (between(0.0, 9.0), between(0.1, 10.0), between(2.0, 9.0), between(0.9, 1.1), between(1.2, 3.0), between(3.5, 8.0)),
    ),
    Case(numerical_scales.depth_count, "ss", "s", (between(0.0, 99.0), between(1.0, 3.0))),
    Case(
        numerical_scales.depth_scales,
        "ssssssss",
        "v",
        (
            between(0.1, 10.0),
            between(2.0, 20.0),
            between(1.0, 3.0),
            between(3.5, 8.0),
            between(9.0, 22.0),
            between(0.1, 9.0),
            between(0.1, 25.0),
            between(0.1, 81.0),
        ),
    ),
    Case(flow_columns.column_speed, "ssss", "s", (between(0.1, 5.0), number, number, number)),
    Case(flow_columns.time_of_passing, "sssss", "s", (between(0.1, 0.2), between(0.0, 0.1), between(0.3, 2.0), speed, speed)),
    Case(numerical_scales.smallest_feature, "ss", "s", (between(0.1, 50.0), between(0.1, 50.0))),
    Case(numerical_scales.relief_friction, "ssss", "s", (between(0.0, 0.5), speed, between(1.0, 20.0), between(0.1, 50.0))),
    Case(timestep.acoustic_limit, "ssss", "s", (angle, step, speed, between(1.0, 300.0))),
    Case(timestep.isolated_limit, "ss", "s", (modulus, modulus)),
    Case(timestep.particle_limit, "ss", "s", (step, between(0.1, 50.0))),
]


def law_cases(law: Law | FrictionLaw) -> list[Case]:
    """The return mapping of a law and the steps that a kernel makes of it; the resistance of a law of friction and its impulse."""
    if isinstance(law, FrictionLaw):
        resistance = Case(law.resistance, "ssssm", "ss", (between(0.0, 5.0), speed, area, step), law=law)
        wet = Case(law.effective_impulse, "vvssmsvss", "v", (*OF_A_CONTACT, share), law=law)
        return [*([resistance] if len(law.laws) == 1 else []), Case(law.impulse, "vvssmsvs", "v", OF_A_CONTACT, law=law), wet]
    returns = [(law.update, "ysm", "yss", (loaded, remembered))] if law.update and len(law.laws) == 1 else []
    steps = [
        (law.step, "ytsm", "yyss", (loaded, rate, remembered)),
        (law.step_small, "ytsm", "yysss", (loaded, rate, remembered)),
        (law.effective_step, "ytsms", "yyss", (loaded, rate, remembered, share)),
        (law.effective_step_small, "ytsms", "yysss", (loaded, rate, remembered, share)),
    ]
    return [Case(*case, SINGLE_PRECISION_OF_A_LAW, law) for case in [*returns, *steps]]
