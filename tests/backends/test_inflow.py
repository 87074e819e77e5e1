"""Mass that enters by a hydrograph, on every backend: volume, place, velocity, what backs up, and the same bits after a stop."""

import logging
import math

import numpy as np
import pytest
import shapely

import runout
from runout import Bed, DruckerPrager, Hydrograph, Inflow, PorePressure, RammsErosion, Release, Terrain
from runout.backends.protocol import BACKENDS, get_backend
from runout.errors import ConfigError, ReleaseError
from runout.model.numerics import Numerics
from runout.release import inlet
from runout.simulation.batch import simulate_batch
from runout.simulation.checkpoint import Checkpoint
from runout.simulation.inflow import source_of
from runout.simulation.scenario import build_scene

EACH = pytest.mark.parametrize("backend", BACKENDS)
ROWS, COLUMNS, CELL, SLOPE = 16, 40, 2.5, 0.5
X = (np.arange(COLUMNS) + 0.5) * CELL
TERRAIN = Terrain.from_array(np.tile(100.0 - SLOPE * X, (ROWS, 1)), (CELL, CELL))  # falls to the east
SOIL = DruckerPrager(density=2000.0, friction_angle=32.0, youngs_modulus=2e6)
WET = PorePressure(ratio=0.5, decay_time=1.5)
LINE = [(20.0, 27.5), (20.0, 12.5)]
FLOOD = Hydrograph([0.5, 1.0, 2.5, 3.0], [0.0, 60.0, 60.0, 0.0], [3.0, 4.0, 4.0, 3.0])
VOLUME = 120.0


def flood(hydrograph=FLOOD, terrain=TERRAIN, **choices):
    place = {} if "polygon" in choices else {"line": LINE}
    return Inflow(terrain, hydrograph, **{**place, **choices})


def run(inflow, backend="scan", releases=(), terrain=TERRAIN, material=SOIL, **choices):
    choices = {"end_time": 4.0, "cell_size": CELL, "precision": "float64", "basal_friction_angle": 20.0, "stop": False, **choices}
    device = {"device": "cpu"} if backend == "hash" else {}
    return runout.simulate(terrain, list(releases), material, inflow=inflow, backend=backend, threads=1, **device, **choices)


def unbooked(result):
    """Largest part of the mass that is neither there, nor gone, nor entered [1]."""
    s = result.series
    sums = s["mass"] + s["escaped_mass"] - s["entered_mass"]
    return np.abs(sums - sums[0]).max() / max(s["entered_mass"][-1], sums[0])


def slab(columns=(20, 26), rows=(4, 12), thickness=2.0):
    cells = np.zeros(TERRAIN.shape)
    cells[slice(*rows), slice(*columns)] = thickness
    return Release.from_array(cells, TERRAIN, placement="on_surface")


@EACH
@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_the_volume_of_the_hydrograph_enters(backend, precision):
    """A site without a release; mass is booked to rounding, and nothing is there before the hydrograph begins."""
    result = run(flood(), backend, precision=precision)
    s, rounding = result.series, 1e-12 if precision == "float64" else 1e-6
    assert s["entered_mass"][-1] == pytest.approx(VOLUME * SOIL.density, rel=rounding)
    assert unbooked(result) <= 1e-12
    assert s["mass"][0] == 0.0
    assert s["escaped_mass"][-1] == 0.0
    assert result.stop_reason == "end time"
    assert result.n_particles == len(result.state) > 100
    assert (result.state.release == 0).all()
    assert len(np.unique(result.state.identity)) == len(result.state)
    x = result.state.position(np.full(3, CELL))
    assert x[:, 0].min() > 20.0 - 0.5 * CELL
    assert np.nanmin(result.fields["arrival_time"]) >= 0.5
    assert result.start["late_source"] == ["inflow"]
    entered = np.interp(s["time"], s["time"], s["entered_mass"]) / SOIL.density
    plane = 4.0 * 1.25 * 60.0 / 4.0  # of a path of a cell at the peak, with a step of the run
    np.testing.assert_allclose(entered, FLOOD.entered.at(s["time"]), atol=plane)


@EACH
@pytest.mark.parametrize("discharge", [60.0, 0.5])
def test_what_is_due_at_the_end_of_the_run_enters(backend, discharge):
    """The run ends with the hydrograph: the last plane, or the only one of a small discharge, is in ledger and maps."""
    hydrograph = Hydrograph([0.5, 1.0, 2.5, 3.0], [0.0, discharge, discharge, 0.0])
    result = run(flood(hydrograph, thickness=1.0), backend, end_time=3.0)
    s, deposit = result.series, result.fields["deposit_thickness"]
    assert s["entered_mass"][-1] == pytest.approx(hydrograph.volume * SOIL.density, rel=1e-12)
    assert s["time"][-1] == 3.0
    assert (np.diff(s["time"]) > 0.0).all()
    assert unbooked(result) <= 1e-12
    assert np.nansum(deposit) * CELL**2 == pytest.approx(hydrograph.volume, rel=1e-6)
    assert np.nanmax(result.fields["max_flow_thickness"]) >= np.nanmax(deposit) * (1 - 1e-6)


@EACH
def test_mass_enters_downslope_at_the_speed_of_the_flow(backend):
    """With the speed of the hydrograph along the ground and the push of the flow upstream, however the line is drawn."""
    steady = Hydrograph([0.0, 2.0], [60.0, 60.0], [4.0, 4.0])
    thickness, steep = 60.0 / 15.0 / 4.0, math.sqrt(1.0 + SLOPE**2)  # normal to the ground
    push = SOIL.rest_ratio * 9.81 / steep * thickness / (2.0 * 4.0)
    for line in (LINE, LINE[::-1]):
        inflow = flood(steady, line=line)
        scene, nothing = build_scene(TERRAIN, [], SOIL, 20.0, Numerics(cell_size=CELL), inflow=[inflow])
        engine = get_backend(backend, **({"device": "cpu"} if backend == "hash" else {}))
        engine.load(scene, nothing)
        source = source_of(inflow, 0, scene.spacing, (2, 2, 4), 2.0)
        source.begin(scene)
        newborn = source.take(engine, source.due)
        expected = np.tile((4.0 + push) / steep * np.array([1.0, 0.0, -SLOPE]), (len(newborn), 1))
        np.testing.assert_allclose(newborn.velocity, expected, rtol=1e-6, atol=1e-9)
        x, y, z = newborn.position(np.array(scene.spacing)).T
        assert (x > 20.0).all()
        assert x.max() < 20.0 + 2 * CELL / 2
        assert (y.min(), y.max()) == pytest.approx((12.5 + 0.5 * 15 / 12, 27.5 - 0.5 * 15 / 12))
        np.testing.assert_allclose(scene.ground.elevation(x, y), 100.0 - SLOPE * x, atol=1e-6)
        above = z - scene.ground.elevation(x, y)
        assert 0.0 < above.min() < 0.1 * thickness
        assert 0.9 * thickness * steep < above.max() < thickness * steep
        assert source.lifted == 0.0


@EACH
def test_an_inflow_joins_a_release(backend):
    """Both masses are there; each has its number, and the balance of mass closes."""
    result = run(flood(), backend, [slab()], end_time=2.5)
    s, p = result.series, result.state
    assert s["mass"][0] == pytest.approx(slab().volume * SOIL.density, rel=1e-9)
    assert set(p.release.tolist()) == {0, 1}
    assert unbooked(result) <= 1e-12
    own = p.mass[p.release == 1].sum()
    assert own == pytest.approx(s["entered_mass"][-1], rel=1e-12)
    apart = run((), backend, [slab()], end_time=2.5)
    np.testing.assert_allclose(s["mass"] - s["entered_mass"], apart.series["mass"][0], rtol=1e-12)


@EACH
def test_a_run_without_inflow_has_the_same_bits(backend):
    same = {"end_time": 1.0, "particles_per_cell": (2, 2, 4)}
    plain = run((), backend, [slab()], **same)
    assert "entered_mass" not in plain.series
    late = flood(Hydrograph([50.0, 60.0], [10.0, 10.0], [2.0, 2.0]))
    other = run(late, backend, [slab()], **same)
    for name in ("flow_thickness", "speed"):
        np.testing.assert_allclose(other.fields[f"max_{name}"], plain.fields[f"max_{name}"], rtol=1e-9, atol=1e-12)
    assert other.series["entered_mass"][-1] == 0.0


@EACH
def test_energy_of_the_inflow_is_booked(backend):
    s = run(flood(), backend).series
    spent = s["basal_dissipation"][-1] + s["plastic_dissipation"][-1] + s["kinetic_energy"][-1]
    assert s["entered_energy"][-1] != 0.0
    assert abs(s["numerical_dissipation"][-1]) < 0.15 * spent


@EACH
def test_interrupted_run_gives_the_same_bits(backend, tmp_path, monkeypatch):
    """A checkpoint holds which births are done, and the volumes of the sources."""
    whole = run(flood(), backend)

    class Stop(Exception):
        pass

    def write(self, state):
        WRITE(self, state)
        if float(state["run.time"]) > 1.6:
            raise Stop

    WRITE = Checkpoint.write
    choices = {"checkpoint": tmp_path / "state.npz", "checkpoint_every": 0.0}
    monkeypatch.setattr(Checkpoint, "write", write)
    with pytest.raises(Stop):
        run(flood(), backend, **choices)
    monkeypatch.setattr(Checkpoint, "write", WRITE)
    resumed = run(flood(), backend, **choices)
    assert resumed.series["time"].tolist() == whole.series["time"].tolist()
    for name in vars(whole.state):
        np.testing.assert_array_equal(getattr(resumed.state, name), getattr(whole.state, name))
    for name, values in whole.fields.items():
        np.testing.assert_array_equal(resumed.fields[name], values, err_msg=name)


def test_another_hydrograph_does_not_continue_a_checkpoint(tmp_path):
    """The key of a run holds all that enters."""
    keys = []
    aside = flood(line=[(21.0, 27.5), (21.0, 12.5)])
    for inflow in (flood(), flood(FLOOD.changed(1.1)), flood(FLOOD.changed(1.0, 0.1)), aside):
        source = source_of(inflow, 0, (CELL,) * 3, (2, 2, 4), 4.0)
        keys.append(b"".join(np.ascontiguousarray(values).tobytes() for values in source.content()))
    assert len(set(keys)) == 4


@EACH
def test_nothing_enters_in_the_place_of_other_mass(backend, caplog):
    """A slab that hardly moves lies on the line: what enters there stands on it. The volume is exact, and is said and recorded."""
    there = slab(columns=(7, 12), rows=(3, 13), thickness=3.0)
    with caplog.at_level(logging.WARNING):
        result = run(flood(), backend, [there], end_time=3.5, basal_friction_angle=32.0)
    assert "inflow inflow: the flow backed up to the line" in caplog.text
    (on_top,) = result.start["inflow_on_top_volume"]
    assert 0.2 * VOLUME < on_top <= VOLUME * (1.0 + 1e-9)
    assert result.series["entered_mass"][-1] == pytest.approx(VOLUME * SOIL.density, rel=1e-9)
    assert unbooked(result) <= 1e-12


def test_new_columns_stand_on_the_particles_that_are_there():
    """At the moment of a birth no particle of it is closer to one that is there than half of their distance."""
    engine = get_backend("reference")
    inflow = flood()
    there = slab(columns=(7, 12), rows=(3, 13), thickness=3.0)
    scene, present = build_scene(
        TERRAIN, [there], SOIL, 20.0, Numerics(cell_size=CELL, particles_per_cell=(2, 2, 4)), inflow=[inflow]
    )
    source = source_of(inflow, 1, scene.spacing, (2, 2, 4), 4.0)
    source.begin(scene)
    engine.load(scene, present)
    newborn = source.take(engine, 1.5)
    assert source.lifted == pytest.approx(source.entered, rel=1e-12)
    there, new = (p.position(np.array(scene.spacing)) for p in (present, newborn))
    for x in (there, new):
        x[:, 2] -= scene.ground.elevation(x[:, 0], x[:, 1])
    own = np.array([source.how.along, source.how.across, source.how.layer])
    apart = np.abs(new[:, None] - there[None]) / own
    assert apart.max(axis=2).min() > 0.45
    assert "inflow inflow: the flow backed up to the line" in source.sentence()
    assert newborn.mass.sum() == pytest.approx(source.entered * SOIL.density, rel=1e-6)
    assert new[:, 2].min() > 2.5


@EACH
def test_a_flow_that_leaves_in_time_is_not_lifted(backend):
    """Where friction takes what the slope gives, the first planes of a steady flow follow each other without overlap and gap."""
    steady = Hydrograph([0.0, 3.5], [60.0, 60.0], [4.0, 4.0])
    result = run(flood(steady), backend, end_time=3.0, basal_friction_angle=math.degrees(math.atan(SLOPE)))
    x = result.state.position(np.full(3, CELL))
    volumes, _ = np.histogram(x[:, 0], np.arange(21.25, 28.0, 1.25), weights=result.state.volume)
    thickness = 60.0 / 15.0 / 4.0 * math.sqrt(1.0 + SLOPE**2)
    np.testing.assert_allclose(volumes / (1.25 * 15.0), thickness, rtol=0.2)
    assert result.start["inflow_on_top_volume"] == [0.0]
    assert result.start["inflow_volume"] == pytest.approx([result.series["entered_mass"][-1] / SOIL.density], rel=1e-6)


@EACH
def test_mass_rises_over_a_polygon(backend):
    """On level ground it stays where it enters; its thickness is volume over area."""
    level = Terrain.from_array(np.zeros((ROWS, COLUMNS)), CELL)
    spring = flood(Hydrograph([0.0, 2.0], [50.0, 50.0]), level, polygon=shapely.box(30.0, 10.0, 50.0, 30.0))
    result = run(spring, backend, terrain=level, end_time=2.0)
    entered = result.series["entered_mass"][-1] / SOIL.density
    assert entered == pytest.approx(100.0, abs=2.0 * 0.25 * 400.0 * CELL / 4)
    assert unbooked(result) <= 1e-12
    x = result.state.position(np.full(3, CELL))
    assert (x[:, 0] > 29.0).all()
    assert (x[:, 0] < 51.0).all()
    assert np.abs(result.state.velocity).max() < 3.0


@EACH
def test_a_wet_inflow_drains_from_when_it_enters(backend):
    result = run(flood(pore_pressure=WET), backend, end_time=3.2)
    p, (begun,) = result.state, result.start["late_source_start_time"]
    first, last = p.pore_left[p.identity.argmin()], p.pore_left[p.identity.argmax()]
    assert 0.0 < first < last < 1.0
    assert first == pytest.approx(math.exp(-(3.2 - begun) / 1.5), rel=1e-3)
    assert (p.pore_excess == 0.5).all()


@EACH
def test_an_inflow_erodes_a_bed(backend):
    """Numbers of births of the bed and of the inflow are distinct, and both are booked."""
    result = run(flood(), backend, bed=Bed(0.5, RammsErosion(rate=0.05, critical_stress=0.0, depth_per_stress=1.0)), end_time=3.0)
    s = result.series
    assert s["entrained_mass"][-1] > 0.0
    sums = s["mass"] + s["escaped_mass"] - s["entered_mass"] - s["entrained_mass"]
    assert np.abs(sums).max() <= 1e-12 * s["mass"][-1]
    assert len(np.unique(result.state.identity)) == len(result.state)


def test_masses_have_their_own_material_and_friction():
    stiff = DruckerPrager(density=1000.0, friction_angle=32.0, youngs_modulus=1e6)
    result = run(flood(material=stiff, basal_friction_angle=math.radians(30.0)), releases=[slab()], end_time=2.0)
    p = result.state
    np.testing.assert_allclose(p.mass[p.release == 1] / p.volume[p.release == 1], 1000.0, rtol=1e-9)
    assert result.start["basal_friction"] == pytest.approx([math.tan(math.radians(20.0)), math.tan(math.radians(30.0))])


def test_the_memory_of_all_births_is_forecast():
    with pytest.raises(runout.CapacityError, match="memory_gb"):
        run(flood(Hydrograph([0.0, 8e4], [60.0, 60.0], [4.0, 4.0])), memory_gb=0.5, end_time=8e4)


def test_neither_release_nor_inflow_is_refused():
    with pytest.raises(ReleaseError, match="neither a release nor an inflow is given"):
        run((), cell_size=CELL)
    with pytest.raises(ConfigError, match=r"inflow is 3; give runout\.Inflow"):
        run([3])


def test_accuracy_takes_the_thickness_at_the_line():
    result = run(flood(), end_time=0.6, cell_size=None, accuracy="screening")
    assert max(result.spacing) <= inlet.mass_at(flood()).thickness.max()


def test_scenarios_that_share_launches_have_no_inflow():
    choices = {"end_time": 1.0, "cell_size": CELL, "basal_friction_angle": 20.0}
    scenario = {"terrain": TERRAIN, "release": [slab()], "material": SOIL, "inflow": flood(), **choices}
    ((_, error),) = simulate_batch([scenario], device="cpu")
    assert isinstance(error, ConfigError)
    assert "inflow inflow: scenarios that share launches have no inflow; simulate it alone" in str(error)
