"""Page of the benchmarks on a GPU, from the records of the scripts ``tests/benchmarks/gpu_*.py``."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from docs.pages.study_page import StudyPage, as_csv, as_png, download, markdown

RECORDS = (
    "gpu",
    "gpu_whole_runs",
    "gpu_error",
    "gpu_site_runs",
    "gpu_friction",
    "gpu_observers",
)  # file names without their ending
STAGES = ("p2g", "nodes and contact", "g2p", "cells")
LARGE = 2e6  # particles; the stages of smaller layers wait for the host
SIZE = ("particles", "10⁹ particle-steps/s", "bytes a particle")
ADDITION = ("with", "10⁹ particle-steps/s", "time of a step over that without", "bytes a particle")
FRICTION = ("layer", "particles", "Coulomb [µs]", "Voellmy, drag at the base", "Voellmy, drag over the column")
OBSERVED = ("cell [m]", "particles", "steps", "transfers", "updates of the maps", "with maps and ledger [s]", "without [s]")
WHOLE = ("device", "cell [m]", "particles", "steps", "wall [s]", "without setup [s]")
ERROR = ("flow", "cells [m]", "particles", "steps", "error", "seconds")
FLOWS = {"jacksboro": "jacksboro, 15°", "frank_slide": "Frank Slide, 15°", "coulomb_only": "CoulombOnly"}
SITE = ("site, cells", "card", "commit", "members", "particles", "wall [s]", "of which members", "largest change of a map")
VERSIONS = ("site, cells", "commit", "wall [s]", "members [s]", "ratio of walls", "error")
SCALING = ("site, cells", "card", "commit", "GPUs", "members", "particle-steps", "seconds")
OPENING = """# Speed on a GPU

Backend `hash` in single precision with everything on: index, sort, contact, material law.

## Throughput

A Drucker-Prager layer slides down a plane with a Courant number of 0.4. Throughput counts whole steps, sorts
included. Memory is all arrays of the backend over the particles.

{sizes}

![Throughput against number of particles; time of each stage](gpu.png)

{options} has double precision, the deterministic mode, runs without a graph, intervals of the sort, and the time of
each stage.

The device agrees with the CPU to {float64:.1e} of the velocity in float64 and to {float32:.1e} in float32, after
100 steps. The deterministic mode repeats itself to the bit, also from a checkpoint.

Several scenes of 100,352 particles in one launch, each with its own ground, friction and time step:

{scenes}

The layer of 1M with another law of friction, or with a wall across. The first wall stands 36 m
below the toe; the mass comes near it, and contacts are searched. A structure far from all mass starts no kernel.

{additions}

    python tests/benchmarks/gpu_throughput.py --device cuda:0 \\
        --skip 64M 100M --out DIR/gpu.json

Record: {gpu[device]}, driver {gpu[driver]}, warp {gpu[warp]}, commit {gpu[commit]}; copy bandwidth {copy:.2f} TB/s in the same run.

Time of a step with Coulomb friction, and how much longer a step with Voellmy friction takes; the laws take turns. Drag slows the
layer, which is then sorted less often.

{friction}

    python tests/benchmarks/gpu_friction.py --device cuda:0 --out DIR/gpu_friction.json

Record: {voellmy[device]}, warp {voellmy[warp]}, commit {voellmy[commit]}.

## Whole runs

Site jacksboro by `runout.simulate` with default particles: 60 s of the flow with maps and ledger.

{runs}

    python tests/benchmarks/gpu_whole_runs.py --device cuda:0 --out DIR/gpu_whole_runs.json

Record: {whole[card]}, commit {whole[commit]}. At 20 m the maps differ from those of the backend scan by {maps}
(relative L1). The setup of the run on
the CPU includes compiling.

## Maps and ledger

A mass of 0.35 million m³ slides for 30 s down a slope onto a plain, with maps and ledger, and without. Small flows wait for the
host, which reads the maps and a row of the ledger every few transfers.

{observed}

    python tests/benchmarks/gpu_observers.py --device cuda:0 --cells 10 5.75 2.71 1.79 \\
        --finer 1 --repeats 6 --out DIR/gpu_observers.json

Record: {observers[card]}, commit {observers[commit]}; maps and ledger of the two large flows on another such card, commit
{observers[commit_of_maps]}; the shortest of three to six runs each.

## Error against time

Relative L1 error of the map of largest thickness of flows of 60 s, against {references}.

{errors}

    RUNOUT_DATA=DATA python tests/benchmarks/gpu_error.py --out DIR/gpu_error.json

Record: {error[device]}, warp {error[warp]}, commit {error[commit]}; each run is the second of two.
{{doc}}`work_precision` has these flows on the CPU.

## From DEM to map

`runout run SITE --device cuda:0` with default particles, from a fresh folder to `hazard.nc` and `report.html`.
Kernels were compiled before on the GPU, not on the CPU. Cells of frank_slide: 20 m where none is given.

{sites}

The same commands with one substep a transfer (before) and with up to four (after), in turns on one machine. Errors are
relative L1 differences of the largest thickness, the mean over the members, from the same members with four substeps and cells of
10 m (jacksboro) and 4 m (frank_slide). Commit ce7702e5 has the bits of f817483a where sums have a fixed order; its error was not
measured again.

{compared}

Record: {versions[card]}; before: commit {versions[commit]}.

Equal cells take longer and have half of the error: a substep of millions of particles takes longer than a step
({{doc}}`substeps`), and maps are summed on half cells, where the raster of frank_slide has 20 m. At the error of 5 m before,
cells of 6.5 m take 0.77 of the time of the command and 0.61 of that of the members. Start, terrain, hazard and report take 10 s of
each. The largest speed depends on the grid ({{doc}}`error_bars`): its error is 3.6 % with 5 m before, 3.0 % with 5 m and 5.8 % with
6.5 m after.

Members alone, workers and scenes included, on one and on two GPUs:

{scaling}

About 7 s of each go to the start of workers and the terrain. With four workers a GPU it is 21.5 s on one and 15.6 s on two.

    python tests/benchmarks/gpu_site_runs.py --folder WORK \\
        --cpu-maps MAPS --out DIR/gpu_site_runs.json

Record: driver {drivers[driver]}, warp {drivers[warp]}; card and commit stand in the tables.

## How to make this page

Copy the records of the scripts above to `tests/benchmarks/records/`; `python -m docs.pages` then
writes this page, its table and its figure. Run the tests of the backend on a GPU by `RUNOUT_TEST_DEVICE=cuda:0
python -m pytest tests/backends -k "hash and not builds_for"`.
"""


def page(records: Mapping[str, Mapping[str, Any]]) -> StudyPage:
    """The page of the records, by their names in :data:`RECORDS`."""
    gpu, whole, error, sites, voellmy, observers = (records[name] for name in RECORDS)
    layers = [r for r in gpu["records"] if "members" not in r]
    differences = whole["records"][1]["against_cpu"].items()
    text = OPENING.format(
        gpu=gpu,
        whole=whole,
        error=error,
        drivers=sites,
        voellmy=voellmy,
        observers=observers,
        observed=markdown(OBSERVED, map(_observed, observers["records"])),
        copy=gpu["copy_bytes_per_second"] / 1e12,
        options=download("gpu.csv", "The full table"),
        float64=gpu["check"]["float64, 100 steps"]["velocity"],
        float32=gpu["check"]["float32, 100 steps"]["velocity"],
        maps=", ".join(f"{100 * v:.2g} % ({name.replace('_', ' ')})" for name, v in differences),
        sizes=markdown(("layer", *SIZE), map(_size, filter(_plain, layers))),
        scenes=markdown(("scenes", *SIZE), _scenes(gpu["records"])),
        additions=markdown(ADDITION, _additions(layers)),
        friction=markdown(FRICTION, map(_friction, voellmy["records"])),
        runs=markdown(WHOLE, map(_whole, whole["records"])),
        errors=markdown(ERROR, map(_error, error["records"])),
        references=", ".join(dict.fromkeys(f"{r['reference']:g} m ({FLOWS[r['problem']]})" for r in error["records"])),
        sites=markdown(SITE, _sites(sites["runs"])),
        versions=sites["versions"],
        compared=markdown(VERSIONS, map(_versions, sites["versions"]["rows"])),
        scaling=markdown(SCALING, _scaling(sites["runs"])),
    )
    return StudyPage("gpu", text, {"gpu.csv": _table(layers)}, {"gpu.png": _figure(gpu["records"])})


def _plain(r: Mapping[str, Any]) -> bool:
    """Whether a record is of a layer as runs have it: float32, a graph, sums in any order, sorted as needed."""
    usual = bool(r["graph"]) and not r["deterministic"] and r["precision"] == "float32"
    return usual and not {"steps_per_sort", "addition"} & set(r)


def _size(r: Mapping[str, Any]) -> tuple[str, ...]:
    return r["name"], f"{r['particles']:,}", f"{r['particle_steps_per_second'] / 1e9:.2f}", f"{r['bytes_per_particle']:.0f}"


def _scenes(found: Iterable[Mapping[str, Any]]) -> Iterator[tuple[str, ...]]:
    for r in found:
        if "members" in r:
            yield (str(r["members"]), *_size(r)[1:])


def _additions(layers: Iterable[Mapping[str, Any]]) -> Iterator[tuple[str, ...]]:
    """What a layer has besides; the first such record has nothing besides."""
    found = [r for r in layers if "addition" in r]
    for r in found[1:]:
        slower = found[0]["particle_steps_per_second"] / r["particle_steps_per_second"]
        yield r["addition"], f"{r['particle_steps_per_second'] / 1e9:.2f}", f"{slower:.2f}", f"{r['bytes_per_particle']:.0f}"


def _friction(r: Mapping[str, Any]) -> tuple[str, ...]:
    """Time of a step with Coulomb friction, and what the laws with drag add to it."""
    seconds = r["seconds_of_step"]
    more = (seconds[law] / seconds["coulomb"] - 1.0 for law in ("voellmy_base", "voellmy"))
    return r["name"], f"{r['particles']:,}", f"{1e6 * seconds['coulomb']:.0f}", *(f"{100 * m:.0f} %" for m in more)


def _whole(r: Mapping[str, Any]) -> tuple[str, ...]:
    seconds = r["seconds"] - r["stages"]["setup"]
    name = "CPU, scan" if r["device"] == "cpu" else "GPU, hash"
    return name, f"{r['cell_size']:g}", f"{r['particles']:,}", f"{r['steps']:,}", f"{r['seconds']:.2f}", f"{seconds:.2f}"


def _observed(r: Mapping[str, Any]) -> tuple[str, ...]:
    seconds = f"{r['seconds']:.2f}", f"{r['seconds_unobserved']:.2f}"
    return f"{r['cell_size']:g}", f"{r['particles']:,}", f"{r['steps']:,}", f"{r['transfers']:,}", f"{r['looks']:,}", *seconds


def _error(r: Mapping[str, Any]) -> tuple[str, ...]:
    flow, error = FLOWS[r["problem"]], f"{100 * r['error']:.2g} %"
    return flow, f"{r['cell']:g}", f"{r['particles']:,}", f"{r['steps']:,}", error, f"{r['seconds']:.2f}"


def _sites(runs: Sequence[Mapping[str, Any]]) -> Iterator[tuple[str, ...]]:
    """Whole runs of sites, those on a CPU among them."""
    for r in runs:
        if r.get("stage") == "members":
            continue
        change = _largest(r.get("against_cpu", {}))
        if "against_gpu" in r:
            change += f"; among runs on the GPU {_largest(r['against_gpu'])}"
        card = _short(r["card"])
        particles = " to ".join(f"{n:,}" for n in sorted({min(r["particles"]), max(r["particles"])}))
        yield (
            *(_named(r["site"]), card, r["commit"], str(r["members"]), particles),
            *(f"{r['seconds']:.0f}", f"{r['ensemble_seconds']:.1f}", change),
        )


def _versions(r: Mapping[str, Any]) -> tuple[str, ...]:
    """Least times of a command by two versions, and the errors of both where they are known."""
    pairs = [(min(r["before"][what]), min(r["after"][what])) for what in ("wall", "members")]
    spans = (f"{before:.1f} and {after:.1f}" for before, after in pairs)
    errors = " and ".join(f"{100 * error:.2g} %" for error in r["error"])
    return (r["site"], r["commit"], *spans, f"{pairs[0][1] / pairs[0][0]:.2f}", errors)


def _largest(differences: Mapping[str, float]) -> str:
    """The largest of the relative differences by name of a map; empty if there are none."""
    worst = max(differences, key=lambda name: float(differences[name]), default="")
    return f"{100 * differences[worst]:.2g} % ({worst.replace('_', ' ')})" if worst else ""


def _scaling(runs: Sequence[Mapping[str, Any]]) -> Iterator[tuple[str, ...]]:
    for r in runs:
        if r.get("stage") == "members":
            head = _named(r["site"]), _short(r["card"]), r["commit"], str(r["workers"]), str(r["members"])
            yield (*head, f"{r['particle_steps']:.3g}", f"{r['ensemble_seconds']:.1f}")


def _short(card: str) -> str:
    """Name of a card, or the cores of a machine without one."""
    return card.removeprefix("none: ").removeprefix("NVIDIA ").removesuffix(" 80GB HBM3")


def _named(folder: str) -> str:
    """Site and size of cells [m] of a copy of a site, as its folder is named."""
    site, *changed = re.split(r"_(?=cell_size|members)", folder)
    size = next((float(c.removeprefix("cell_size")) for c in changed if c.startswith("cell_size")), None)
    return f"{site}, {size:g} m" if size else site


def _table(layers: Sequence[Mapping[str, Any]]) -> str:
    """Every layer with its options and stages, as CSV."""
    stages = list(dict.fromkeys(name for r in layers for name in r["stage_seconds"]))
    keys = ("name", "particles", "precision", "graph", "deterministic", "steps_per_sort", "addition", "steps")
    heads = (*keys, "particle-steps per second", "bytes a particle", *(f"{name} [ms]" for name in stages))
    rows = [
        (
            *(r.get(key) for key in keys),
            f"{r['particle_steps_per_second']:.4g}",
            r["bytes_per_particle"] and f"{r['bytes_per_particle']:.1f}",
            *(f"{1e3 * r['stage_seconds'][name]:.3f}" if name in r["stage_seconds"] else None for name in stages),
        )
        for r in layers
    ]
    return as_csv(heads, rows)


def _figure(records: Sequence[Mapping[str, Any]]) -> bytes:
    """PNG of throughput against size, batched scenes beside one; stages of the largest layers."""
    from matplotlib.figure import Figure

    plain = [r for r in records if _plain(r)]
    canvas = Figure(figsize=(10, 4), layout="constrained")
    left, right = canvas.subplots(1, 2)
    for label, chosen in (
        ("one scene", [r for r in plain if "members" not in r and "thin" not in r["name"]]),
        ("scenes of 100,352 particles in one launch", [r for r in plain if "members" in r]),
    ):
        chosen.sort(key=lambda r: r["particles"])
        rates = [r["particle_steps_per_second"] / 1e9 for r in chosen]
        left.semilogx([r["particles"] for r in chosen], rates, "o-", label=label)
    left.set(xlabel="particles", ylabel="10$^9$ particle-steps per second", ylim=(0, None))
    left.legend(frameon=False)
    wanted = [r for r in plain if "members" not in r and r["particles"] > LARGE]
    below = [0.0] * len(wanted)
    for stage in STAGES:
        share = [1e9 * r["stage_seconds"][stage] / r["particles"] for r in wanted]
        right.bar([r["name"] for r in wanted], share, bottom=below, label=stage)
        below = [a + b for a, b in zip(below, share, strict=True)]
    right.set(ylabel="ns per particle and step", ylim=(0, 1.35 * max(below, default=1.0)))
    right.legend(frameon=False, ncols=2)
    return as_png(canvas)
