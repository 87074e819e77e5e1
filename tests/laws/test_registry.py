"""Laws are found by name: one file inside the package, an entry point or an import outside; what is wrong with one is said."""

import ast
import importlib
import importlib.util
import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
import quadratic_flow
import xarray as xr
from quadratic_flow import QuadraticFlow
from ramp_site import SITE, write_site
from scenes import scene

import runout
from runout.backends.compile import numba_binding
from runout.errors import ConfigError, MaterialError
from runout.model import registry
from runout.model.friction_laws import FRICTIONS
from runout.model.laws import LAWS
from runout.model.parameters import parameter
from runout.model.particles import Particles
from runout.model.registry import modules_of
from runout.physics.tensors import real, scaled
from runout.simulation.checkpoint import run_key
from runout.workflow.check import inspect

ROOT = Path(__file__).parents[2]
DP = "friction_angle_deg: 30}"
MUD = SITE.replace(DP, "law: quadratic_flow, yield_stress: 500, viscosity: 50}")
SAMPLED = "    basal_friction_angle_deg: {distribution: uniform, low: 12, high: 22}\n"


def python(*command, path):
    """A fresh interpreter in which only what is installed is known."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(path), str(ROOT)])}
    return subprocess.run(
        [sys.executable, *map(str, command)], env=environment, capture_output=True, text=True, timeout=300, check=False
    )


def test_only_the_file_of_a_law_names_it():
    """A new law of runout touches no other file but its test. A constant of each kind names the default."""
    kinds = {LAWS: "materials", FRICTIONS: "friction"}
    laws = [(kind, law) for kind in kinds for law in kind.of_runout()]
    words = {word for kind, law in laws for word in (law.name, law.declaration.__name__, f"{kind.package}.{law.name}")}
    own = {ROOT / "runout" / kinds[kind] / f"{law.name}.py" for kind, law in laws}
    studies = ROOT / "runout" / "studies"  # each is about some law
    files = [*(ROOT / "runout").rglob("*.py"), *(ROOT / "docs" / "_ext").glob("*.py")]
    python_files = [file for file in files if file not in own and studies not in file.parents]
    named = [(file.name, word) for file in python_files for word in words_of(ast.parse(file.read_text())) if word in words]
    assert sorted(set(named)) == [("friction_laws.py", "coulomb"), ("material.py", "drucker_prager")]


def words_of(tree):
    """Names that a module imports or reads as attributes, and its texts, but for the names of modules of physics."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            yield from (node.module or "", *(alias.name for alias in node.names if node.module != "runout.physics"))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value not in modules_of("runout.physics"):
            yield node.value
        elif isinstance(node, ast.Attribute) and node.attr[:1].isupper():
            yield node.attr


def test_every_law_is_public():
    for law in (*LAWS.of_runout(), *FRICTIONS.of_runout()):
        assert getattr(runout, law.declaration.__name__) is law.declaration
        assert law.declaration.__name__ in runout.__all__


def test_settings_of_a_law_from_outside_derive_from_its_declarations(tmp_path):
    site = runout.read_site(
        write_site(tmp_path / "site", MUD.replace(SAMPLED, "    collisions: {distribution: uniform, low: 3, high: 9}\n"))
    )
    material = site.material({"collisions": 4.0})
    assert isinstance(material, QuadraticFlow)
    assert (material.yield_stress, material.viscosity, material.collisions, material.density) == (500.0, 50.0, 4.0, 2000.0)
    assert site.computed()["material"]["source"] == LAWS.find("quadratic_flow").fingerprint  # members follow a changed law
    assert inspect(tmp_path / "site").problems == []


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (MUD.replace("yield_stress: 500", "yield_stress: 0.5"), "material.yield_stress: 0.5 Pa is out of range; .* 2 kPa is 2.0e3"),
        (MUD.replace("yield_stress: 500, ", ""), "material.yield_stress: required key is missing; add it: shear stress below"),
        (MUD.replace("yield_stress", "yield_stres"), "material.yield_stres: unknown key; did you mean 'yield_stress'"),
        (
            MUD.replace("quadratic_flow", "quadratic_flo"),
            "material.law: 'quadratic_flo' is not known; did you mean 'quadratic_flow'",
        ),
        (MUD.replace("quadratic_flow", "./my_law.py"), "material.law: './my_law.py' is not known"),
        (MUD.replace("quadratic_flow", "os"), "material.law: 'os' is not known"),
        (
            MUD.replace(SAMPLED, "    friction_angle_deg: {distribution: uniform, low: 12, high: 22}\n"),
            "friction_angle_deg: the law quadratic_flow has no such parameter; remove it, or use law: .* or drucker_prager",
        ),
        (
            MUD.replace(SAMPLED, "    collisions: {distribution: uniform, low: -1, high: 9}\n"),
            "collisions: it can give -1 Pa s2; the parameter must be at least 0",
        ),
    ],
)
def test_wrong_settings_of_a_law_get_the_place_and_the_remedy(tmp_path, text, said):
    with pytest.raises(ConfigError, match=said):
        runout.read_site(write_site(tmp_path / "site", text))


def test_parameters_of_granular_flow_are_sampled(tmp_path):
    grains = "law: granular_flow, static_friction: 0.38, dynamic_friction: 0.64, grain_size: 0.02}"
    sampled = "".join(f"    {key}: {{distribution: uniform, low: {low}, high: {high}}}\n" for key, low, high in (
        ("static_friction", 0.3, 0.4), ("dynamic_friction", 0.5, 0.7), ("inertial_constant", 0.2, 0.3), ("grain_size", 0.01, 0.1),
    ))  # fmt: skip
    site = runout.read_site(write_site(tmp_path / "site", SITE.replace(DP, grains).replace(SAMPLED, sampled)))
    from runout.ensemble.member import plan_members

    materials = [site.material(member.parameters) for member in plan_members(site)]
    assert len({m.grain_size for m in materials}) == 4
    assert all(0.3 < m.static_friction < 0.4 and 0.5 < m.dynamic_friction < 0.7 for m in materials)


def test_an_installed_package_is_found_by_commands_and_workers(tmp_path, installed):
    sampled = "    yield_stress: {distribution: uniform, low: 300, high: 900}\n"
    text = (
        MUD.replace(SAMPLED, sampled).replace("members: 4", "members: 2").replace("end_time: 20", "end_time: 1, backend: reference")
    )
    folder = write_site(tmp_path / "site", text)
    done = python("-m", "runout", "ensemble", folder, "--workers", 2, path=installed)
    assert done.returncode == 0, done.stdout + done.stderr
    found = []
    for path in (folder / "results" / "members").glob("*.nc"):
        with xr.open_dataset(path) as member:
            found.append(json.loads(member.attrs["parameters"])["yield_stress"])
    assert len(found) == 2
    assert all(300 < value < 900 for value in found)
    assert found[0] != found[1]


def test_a_package_that_cannot_be_imported_harms_only_who_names_it(tmp_path, installed):
    (installed / "mud_laws-1.0.dist-info" / "entry_points.txt").write_text("[runout.laws]\nbroken = broken_law\n")
    (installed / "broken_law.py").write_text("import no_such_library\n")
    folder = write_site(tmp_path / "site", SITE.replace(DP, "law: broken}"))
    done = python("-m", "runout", "check", folder, path=installed)
    assert done.returncode != 0
    said = " ".join((done.stdout + done.stderr).split())
    assert "material law broken of mud-laws 1.0: ModuleNotFoundError: No module named 'no_such_library'" in said
    assert "mend or uninstall that package" in said
    program = "from runout.config.read import load; import sys; print(load(sys.argv[1]).material.law)"
    assert python("-c", program, write_site(tmp_path / "other"), path=installed).stdout == "drucker_prager\n"


@dataclass(frozen=True, kw_only=True)
class Sound(runout.Material):
    """A law that holds together."""

    law: ClassVar[str] = "sound"
    softness: float = parameter("something", low=0, high=1, typical=0.5)


def by_power(h, history, mat):
    return scaled(h, real(1.0) - mat.softness**2), history, real(0.0)


def by_power_of_the_share(h, history, mat, effective):
    return scaled(h, effective**2), history, real(0.0)


def by_module(h, history, mat):
    return scaled(h, np.sqrt(mat.softness)), history, real(0.0)


def of_two(h, mat):
    return h


@pytest.mark.parametrize(
    ("update", "said"),
    [
        (
            by_power,
            r"test_registry.py: by_power cannot be compiled: line \d+: \*\* with an integer does not compile in warp: multiply",
        ),
        (by_module, "np is a module; import the names that are used from it"),
        (of_two, r"update must be a plain function of \(h, history, mat, effective\) or \(h, history, mat\)"),
        (by_power_of_the_share, r"\*\* with an integer does not compile in warp"),
    ],
)
def test_a_law_that_compilers_would_not_read_alike_is_refused(update, said):
    with pytest.raises(MaterialError, match=said):
        runout.register_law(Sound, update)


def test_a_law_needs_a_name_of_its_own_and_declared_parameters():
    @dataclass(frozen=True, kw_only=True)
    class Clash(runout.Material):
        law: ClassVar[str] = "drucker_prager"

    @dataclass(frozen=True, kw_only=True)
    class Undeclared(runout.Material):
        law: ClassVar[str] = "undeclared"
        softness: float = 1.0

    class Undecorated(runout.Material):
        law: ClassVar[str] = "undecorated"
        softness: float = parameter("something", low=0, high=1, typical=0.5)

    for law, said in (
        (Clash, "have the same name; choose another one"),
        (Undeclared, r"softness is not declared; write softness: float = parameter\(\.\.\.\)"),
        (Undecorated, "write a frozen dataclass"),
    ):
        with pytest.raises(MaterialError, match=said):
            runout.register_law(law)


def test_a_changed_law_is_compiled_anew(tmp_path, monkeypatch):
    """The same name and class; only a number in the source differs."""
    source = Path(quadratic_flow.__file__).read_text().replace("quadratic_flow", "changing")
    kernel = tmp_path / "kernel.py"
    kernel.write_text(
        "def law_return(h, history, mat):\n    return h\n\ndef left(h, mat):\n    return law_return(h, 0.0, mat)[0][3]\n"
    )
    found, keys = [], set()
    for factor in ("2.0", "3.0"):
        (tmp_path / "changing.py").write_text(source.replace("real(2.0)) * mat.shear", f"real({factor})) * mat.shear"))
        loaded("changing", tmp_path / "changing.py", monkeypatch)
        law, numbers = LAWS.find("changing"), numba_binding(np.float64, False)
        keys.add(run_key(scene(materials=(law.example,)), Particles.zeros(0)))
        kernels = numbers.kernels(loaded("kernel", kernel, monkeypatch), law_return=numbers.law(law).update)
        table = law.table((law.example,))
        law.set_step(table, 1e-3)
        found.append(kernels.left((-1e-2, -1e-2, -1e-2, 1e-2, 0.0, 0.0), table[0]))
    assert found[0] == pytest.approx(found[1] * np.sqrt(1.5))
    assert len(keys) == 2  # nor does a run go on from a checkpoint of the law as it was


def loaded(name, path, monkeypatch):
    monkeypatch.setattr(sys, "dont_write_bytecode", True)  # bytecode of a file of the same size and second would be taken for new
    spec = importlib.util.spec_from_file_location(name, path)
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, name, module)
    spec.loader.exec_module(module)
    return module


def test_entry_points_of_all_packages_are_read_once_a_search_path(monkeypatch):
    read, wanted = [], registry.entry_points
    monkeypatch.setattr(registry, "entry_points", lambda: read.append(1) or wanted())
    monkeypatch.setattr(sys, "path", [*sys.path, "/nowhere"])
    for _ in range(2):
        LAWS.names()
        FRICTIONS.names()
    assert len(read) == 1


@pytest.mark.parametrize("law", LAWS.of_runout(), ids=lambda law: law.name)
def test_every_law_of_runout_is_set_sampled_and_checked_in_a_site(tmp_path, law):
    own = [p for p in law.parameters if p.name not in {q.name for q in LAWS.find("elastic").parameters}]
    numbers = {p.key: p.typical for p in own if p.valid}
    block = "".join(f", {key}: {value!r}" for key, value in numbers.items())
    (*_, drawn) = [p for p in law.parameters if p.sampled and p.valid and p.typical > p.valid.low and p.name != "youngs_modulus"]
    low = 0.9 * drawn.typical + 0.1 * drawn.valid.low
    distribution = f"    {drawn.key}: {{distribution: uniform, low: {low!r}, high: {drawn.typical!r}}}\n"
    text = SITE.replace(DP, f"law: {law.name}{block}}}").replace(SAMPLED, SAMPLED + distribution)
    folder = write_site(tmp_path / "site", text)
    material = runout.read_site(folder).material({drawn.key: low})
    assert type(material) is law.declaration
    assert getattr(material, drawn.name) == low
    assert inspect(folder).problems == []
