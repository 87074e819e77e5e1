"""A law from outside the package, importable here and in other processes."""

import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT / "tests" / "physics"), str(ROOT / "tests" / "backends"), str(ROOT / "tests" / "workflow")]


def install(folder: Path, package: str, group: str, source: Path) -> Path:
    """A folder that, on the path of Python, is an installed package with the law of one file."""
    law = source.stem
    metadata = folder / f"{package.replace('-', '_')}-1.0.dist-info"
    metadata.mkdir(parents=True)
    (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(f"[{group}]\n{law} = {law}\n")
    (folder / f"{law}.py").write_text(source.read_text())
    return folder


@pytest.fixture
def installed(tmp_path):
    """Folder of an installed package whose entry point names the law of the material."""
    return install(tmp_path / "installed", "mud-laws", "runout.laws", Path(__file__).with_name("quadratic_flow.py"))


@pytest.fixture
def installed_friction(tmp_path):
    """The same for a law of friction."""
    return install(tmp_path / "installed", "load-drag", "runout.friction", Path(__file__).with_name("drag_by_load.py"))
