"""The benchmark measures what it says; nothing here depends on how fast a machine is."""

import json
import os
import socket

import numpy as np
import pytest

from docs.pages.bench_figure import draw
from runout.cli import main
from runout.errors import ConfigError, ExitCode
from runout.studies import work_precision
from runout.studies.sloping_layer import SPACING, Layer
from runout.studies.timing import Case, TimedRun, take_turns
from runout.studies.work_precision import Choices, cost_table, table
from tests.benchmarks import prototype

SMALL = Choices(threads=(1,), precision=("float32",), sizes=(1500,), size=1500, repetitions=2)


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """JSON of a very small benchmark."""
    folder = tmp_path_factory.mktemp("bench")
    work_precision.run(SMALL, folder / "bench.json")
    return folder


@pytest.fixture(scope="module")
def content(bench):
    return json.loads((bench / "bench.json").read_text())


def test_json_holds_every_study_and_the_ratios_that_follow(content):
    assert content["schema"] == work_precision.SCHEMA
    assert set(content["studies"]) == {"size", "precision", "depth", "sparsity"}
    layers = {(m["case"]["depth"], m["case"]["upwards"]): m["rate"] for m in content["studies"]["depth"]}
    assert [(x["depth"], x["upwards"]) for x in content["ratios"]["thin_over_deep"]] == [(2, 4), (3, 4), (2, 2), (3, 2)]
    assert [x["ratio"] for x in content["ratios"]["thin_over_deep"]] == pytest.approx(
        [layers[x["depth"], x["upwards"]] / layers[16, x["upwards"]] for x in content["ratios"]["thin_over_deep"]]
    )
    assert [x["sparsity"] for x in content["ratios"]["sparsity"] if x["index"] == "sparse"] == list(work_precision.SPARSITIES)
    assert all(x["of_bandwidth"] > 0 and x["of_arithmetic"] > 0 for x in content["ratios"]["roofline"])


def test_every_stage_has_a_time_and_observers_count(content):
    for measurement in content["studies"]["size"] + content["studies"]["depth"]:
        stages = measurement["ns_per_particle_step"]
        assert {"index", "contact", "sort", "observers"} <= set(stages)
        assert all(seconds >= 0 for seconds in stages.values())
        assert measurement["clock"] == "processor"
        assert measurement["rate"] < measurement["rate_of_steps"]


def test_json_names_neither_the_machine_nor_a_path(content):
    text = json.dumps(content)
    assert f'"{socket.gethostname()}"' not in text
    assert os.path.expanduser("~") not in text
    assert set(content["machine"]) == {"cores", "vector_bits", "architecture"}


def test_figure_of_the_documentation_is_drawn(content, tmp_path):
    assert draw(content, tmp_path / "bench.png").read_bytes().startswith(b"\x89PNG")


def test_tables_show_every_ratio(content):
    shown = table(content)
    assert "layer of 2 cells over one of 16" in shown
    assert "sparse, sparsity 400, over sparse 1" in shown
    assert "bytes a particle" in cost_table(content)


def test_cases_take_turns_in_changing_order(monkeypatch):
    turns = []
    monkeypatch.setattr(TimedRun, "repeat", lambda timed: turns.append(timed.case.layer.depth))
    monkeypatch.setattr(TimedRun, "measured", lambda timed: {})
    take_turns([TimedRun(Case(Layer(1500, depth=d))) for d in (2, 4)], 2)
    assert turns == [2, 4, 4, 2]


@pytest.mark.parametrize(
    "layer",
    [Layer(1500), Layer(1500, depth=2, sparsity=10.0, aligned=True), Layer(3000, precision="float64"), Layer(3000, upwards=4)],
)
def test_layer_is_what_it_says(layer):
    scene, p = layer.build()
    assert len(p) == 4 * layer.upwards * np.prod([*layer.columns, layer.depth])
    assert abs(len(p) / layer.particles - 1) < 0.1
    assert scene.precision == layer.precision
    x = p.position(np.full(3, SPACING))
    above = (x[:, 2] - scene.surface.elevation(x[:, 0], x[:, 1])) / SPACING
    assert above.min() >= 0
    assert layer.depth - 0.5 < above.max() < layer.depth + 0.5
    assert p.volume.sum() == pytest.approx(SPACING**3 * np.prod([*layer.columns, layer.depth]))
    length = np.ptp(x[:, 1]) / SPACING
    assert length == pytest.approx(layer.columns[1] * layer.sparsity, abs=1.0)
    assert p.mass.sum() == pytest.approx(2000.0 * SPACING**3 * len(p) / (4 * layer.upwards))


def test_layout_for_the_prototype_finds_every_particle_in_its_cell_and_every_node_block():
    node = Layer(1500).build()[1].node
    order, (up, down, cells) = prototype.block_layout(node)
    assert sorted(order) == list(range(len(node)))
    moved = (node - node.min(axis=0) + 8)[order]
    for cell in np.flatnonzero(np.diff(cells)):
        own = moved[cells[cell] : cells[cell + 1]]
        assert (own == own[0]).all()
        assert tuple(own[0] & 3) == (cell >> 4 & 3, cell >> 2 & 3, cell & 3)
    for owner, reached in enumerate(up):
        assert reached[0] == owner
        assert all(down[block, corner] == owner for corner, block in enumerate(reached))


@pytest.mark.parametrize(
    ("choices", "said"), [({"threads": (0,)}, "--threads is"), ({"precision": ("float16",)}, "float32, float64 or both")]
)
def test_choices_that_cannot_be_measured_are_refused(choices, said):
    with pytest.raises(ConfigError, match=said):
        Choices(**choices)


def test_a_script_that_is_no_prototype_is_refused_in_one_sentence(tmp_path):
    script = tmp_path / "other.py"
    script.write_text("nothing = 0\n")
    with pytest.raises(ConfigError, match="has no p2g"):
        prototype.load_prototype(script)
    with pytest.raises(ConfigError, match="does not exist"):
        prototype.load_prototype(tmp_path / "missing.py")


def test_command_writes_the_record_to_the_stated_folder(tmp_path, monkeypatch):
    written = []
    monkeypatch.setattr(work_precision, "run", lambda choices, json_file: written.append(json_file))
    monkeypatch.setattr(work_precision, "report", lambda content: None)
    assert main(["bench", "--out", str(tmp_path)]) == ExitCode.OK
    assert main(["bench"]) == ExitCode.OK
    assert written == [tmp_path / "bench.json", None]
