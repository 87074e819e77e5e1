"""The architecture of docs/architecture: imports go one way, compilers stay where they belong, functions stay small."""

import ast
import importlib.util
import inspect
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

import runout
from runout.model.readers import declared_readers, reader

ROOT = Path(__file__).parents[1]
SOURCES = sorted([*(ROOT / "runout").rglob("*.py"), *(ROOT / "pipelines").rglob("*.py")])
LARGEST_FUNCTION = 40
LARGEST_KERNEL = 60  # of the compiled backends
LARGEST_REFERENCE = 620
HOMES = {
    "numba": (
        *("runout/backends/scan/", "runout/backends/lanes/", "runout/backends/compile.py", "runout/backends/roofline.py"),
        *("runout/structures/lattice_distance.py", "runout/safe_start.py"),  # the second: its settings
    ),
    "warp": ("runout/backends/hash/", "runout/backends/compile.py"),
}
IMPORT_NAMES = {
    "warp-lang": "warp",
    "ruamel.yaml": "ruamel",
    "pillow": "PIL",
    "dask-jobqueue": "dask_jobqueue",
    "scikit-learn": "sklearn",
    "pystac-core": "pystac",
    "imageio-ffmpeg": "imageio_ffmpeg",
}  # where it differs from the name of the distribution
OF_QGIS = {"qgis", "processing"}  # libraries of the program that loads the plugin
NOT_IMPORTED = {"cryptography", "requireit", "lavavu-osmesa"}  # dask and landlab import two; VTK loads a library of the third
COME_WITH = {  # always, in a version that fits
    "llvmlite": "numba",
    "pydantic_core": "pydantic",
    "mpl_toolkits": "matplotlib",
    "threadpoolctl": "sklearn",
}
HEAVY = (
    "numba",
    "warp",
    "rasterio",
    "xarray",
    "pandas",
    "geopandas",
    "shapely",
    "pyproj",
    "matplotlib",
    "scipy",
    "pydantic",
    "trimesh",
)


def place(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


@cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text())


@cache
def nodes(path: Path) -> list[ast.AST]:
    return list(ast.walk(parsed(path)))


@cache
def imported(path: Path) -> list[tuple[int, str]]:
    """Line and full name of every module that a file imports, or imports from."""
    found: list[tuple[int, str]] = []
    for node in nodes(path):
        if isinstance(node, ast.Import):
            found += ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            found.append((node.lineno, node.module or ""))
    return found


def functions(path: Path) -> Iterator[tuple[str, int]]:
    """Name and length of the body, without its docstring, of every function of a file."""
    for node in nodes(path):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            body = node.body[1:] if ast.get_docstring(node) else node.body
            yield node.name, node.end_lineno - body[0].lineno + 1 if body else 0


def loaded_by(statement: str) -> set[str]:
    """Names of HEAVY that a fresh interpreter has loaded after a statement."""
    code = f"import sys\n{statement}\nprint(*(m for m in {HEAVY!r} if m in sys.modules))"
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True, cwd=ROOT)
    return set(done.stdout.split())


@pytest.mark.skipif(importlib.util.find_spec("importlinter") is None, reason="import-linter is not installed")
def test_imports_keep_the_contracts_of_pyproject():
    command = "from importlinter.cli import lint_imports; raise SystemExit(lint_imports(no_cache=True))"
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, "-c", command], env=environment, capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stdout + done.stderr


def module_of(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def own_imports(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Line and name of every module of runout that a tree imports, outside of blocks for type checkers."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "runout":
            below = [f"{node.module}.{alias.name}" for alias in node.names]
            yield from ((node.lineno, name if name in MODULES else node.module) for name in below)
        elif isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names if alias.name.split(".")[0] == "runout")
        elif not (isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"):
            yield from own_imports(node)


def layers() -> Iterator[dict[str, int]]:
    """Number of the layer of each module or package that a contract names, the lowest first; one table a contract."""
    for contract in tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]:
        if contract["type"] == "layers":
            (container,) = contract["containers"]
            names = [re.findall(r"\w+", layer) for layer in reversed(contract["layers"])]
            yield {f"{container}.{name}": k for k, alike in enumerate(names) for name in alike}


MODULES = {module_of(path) for path in SOURCES}


def test_no_import_inside_a_function_goes_against_the_layers():
    inside, against = [], []
    for path in SOURCES:
        home = module_of(path)
        for node in nodes(path):
            if isinstance(node, ast.FunctionDef):
                inside += [(home, line, name) for line, name in own_imports(node)]
    for table in layers():
        ranks = {module: table[place] for place in table for module in MODULES if f"{module}.".startswith(f"{place}.")}
        for home, line, name in set(inside):
            if ranks.get(name, 0) > ranks.get(home, len(table)):
                against.append(f"{home}:{line}: {name}")
    assert len(inside) > 100
    assert against == []


def test_packages_import_each_other_in_no_circle():
    graph: dict[str, set[str]] = {}
    for path in SOURCES:
        home = ".".join(module_of(path).split(".")[:2])
        for _, name in own_imports(parsed(path)):
            other = ".".join(name.split(".")[:2])
            if home.startswith("runout.") and other.startswith("runout.") and other != home:
                graph.setdefault(home, set()).add(other)
    order = list(TopologicalSorter(graph).static_order())  # graphlib.CycleError names the circle
    assert order.index("runout.physics") < order.index("runout.model") < order.index("runout.terrain") < order.index("runout.cli")


@pytest.mark.parametrize(("constructor", "home"), declared_readers().items())
def test_each_constructor_passes_what_its_reader_takes(constructor, home):
    name, _, method = constructor.partition(".")
    passed = inspect.signature(getattr(getattr(runout, name), method)).parameters.values()
    taken = inspect.signature(reader(constructor)).parameters
    assert home.split(":")[0] in MODULES
    assert [p.name for p in passed if p.kind is not p.VAR_KEYWORD and p.name not in {*taken, "self"}] == []


def test_no_file_keeps_the_marks_of_a_merge():
    """Inside a docstring, no compiler or linter finds them."""
    marked = re.compile(r"^(<{7}|>{7}) ", re.MULTILINE)
    texts = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *(ROOT / "tests").rglob("*.py")]
    files = [*SOURCES, *texts]
    assert [place(p) for p in files if marked.search(p.read_text(encoding="utf-8"))] == []


@pytest.mark.parametrize("compiler", HOMES)
def test_compiler_is_imported_only_where_it_belongs(compiler):
    strays = [f"{place(p)}:{line}" for p in SOURCES for line, name in imported(p) if name.split(".")[0] == compiler]
    assert strays
    assert [s for s in strays if not s.startswith(HOMES[compiler])] == []


def test_only_get_backend_imports_a_backend():
    backends = {f"runout.backends.{name}" for name in ("scan", "hash", "reference")}
    strays = []
    for path in SOURCES:
        home = ".".join(path.relative_to(ROOT).with_suffix("").parts)
        for line, module in imported(path):
            own = any(home.startswith(b) and module.startswith(b) for b in backends)
            if module.startswith(tuple(backends)) and not own:
                strays.append(f"{place(path)}:{line}: {module}")
    assert strays == []


@pytest.mark.parametrize(
    "statement", ["import runout", "import runout.backends.protocol, runout.model.scene", "from runout import DruckerPrager"]
)
def test_import_of_the_core_loads_no_compiler_and_no_raster_library(statement):
    assert loaded_by(statement) == set()


def test_import_of_the_time_loop_loads_no_raster_or_plotting_library():
    assert loaded_by("import runout.simulation.single") & {"rasterio", "geopandas", "matplotlib", "warp"} == set()


def test_every_public_name_can_be_imported():
    assert [name for name in runout.__all__ if not hasattr(runout, name)] == []
    assert set(runout.__all__) <= set(dir(runout))
    with pytest.raises(AttributeError, match="no_such_name"):
        _ = runout.no_such_name


@pytest.mark.parametrize("path", SOURCES, ids=place)
def test_functions_of_a_file_are_small_enough_to_read(path):
    compiled = place(path).startswith(("runout/backends/scan/", "runout/backends/hash/", "runout/backends/lanes/"))
    limit = LARGEST_KERNEL if compiled and path.name != "backend.py" else LARGEST_FUNCTION
    assert {name: length for name, length in functions(path) if length > limit} == {}


def test_reference_backend_stays_within_its_lines():
    folder = ROOT / "runout" / "backends" / "reference"
    lines = [line for p in folder.glob("*.py") for line in p.read_text().splitlines() if line.strip()]
    assert len(lines) <= LARGEST_REFERENCE


@pytest.mark.parametrize("path", SOURCES, ids=place)
def test_everything_public_says_what_it_is(path):
    tree = parsed(path)
    silent = [] if ast.get_docstring(tree) else ["module"]
    for node in tree.body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_") and not ast.get_docstring(node):
            silent.append(node.name)
    constructors = {"vec", "sym", "tens"}  # three tuples that the compilers replace
    assert [name for name in silent if name not in constructors] == []


def test_files_are_named_after_what_they_hold():
    vague = {"utils", "util", "helper", "helpers", "manager", "misc", "common", "tools"}
    assert [place(p) for p in SOURCES if vague & set(p.stem.split("_"))] == []


def test_every_dependency_is_imported_and_every_import_is_a_dependency():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = [line for name, lines in project["optional-dependencies"].items() if name != "test" for line in lines]
    stated = [*project["dependencies"], *extras]
    names = {re.match(r"[\w.-]+", line)[0] for line in stated} - NOT_IMPORTED
    modules = {IMPORT_NAMES.get(name, name) for name in names}
    tops = {name.split(".")[0] for path in SOURCES for _, name in imported(path)}
    used = {COME_WITH.get(name, name) for name in tops}
    assert modules == used - set(sys.stdlib_module_names) - {"runout", "pipelines", ""} - OF_QGIS


def test_errors_are_never_caught_wholesale():
    broad = []
    for path in SOURCES:
        for node in nodes(path):
            if not isinstance(node, ast.ExceptHandler) or isinstance(node.body[-1], ast.Raise):
                continue  # to clean up and raise again is no catch
            if node.type is None or ast.unparse(node.type) in ("Exception", "BaseException"):
                broad.append(f"{place(path)}:{node.lineno}")
    assert broad == []


CHECKS = ("raises", "warns", "fail", "assert_")  # of pytest and numpy


def _checks(function: ast.AST) -> bool:
    """Whether a function holds an assertion, in its own words."""
    inside = list(ast.walk(function))
    calls = (node.func for node in inside if isinstance(node, ast.Call))
    names = (getattr(call, "attr", getattr(call, "id", "")) for call in calls)
    return any(isinstance(node, ast.Assert) for node in inside) or any(n.startswith(CHECKS) for n in names)


def test_every_test_asserts_something_and_none_skips_where_a_module_of_runout_is_missing():
    trees = {path: ast.parse(path.read_text()) for path in sorted((ROOT / "tests").rglob("*.py"))}
    functions = [(path, node) for path, tree in trees.items() for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    helpers = {node.name for _, node in functions if not node.name.startswith("test_") and _checks(node)}
    tests = [(path, node) for path, node in functions if node.name.startswith("test_") and path.name.startswith("test_")]
    assert len(tests) > 3000
    silent = []
    for path, test in tests:
        called = {getattr(node.func, "id", "") for node in ast.walk(test) if isinstance(node, ast.Call)}
        silent += [f"{place(path)}: {test.name}"] if not (_checks(test) or called & helpers) else []
    assert silent == []
    skipping = [place(path) for path in trees if re.search(r"importorskip\(\s*[\"']runout", path.read_text())]
    assert skipping == []
