"""A law from outside the package: the example of the documentation, importable here and in other processes."""

import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "docs" / "examples"
sys.path[:0] = [str(EXAMPLES), str(ROOT / "tests" / "physics"), str(ROOT / "tests" / "backends"), str(ROOT / "tests" / "workflow")]


@pytest.fixture
def installed(tmp_path):
    """Folder that, on the path of Python, is an installed package whose entry point names the law."""
    folder = tmp_path / "installed"
    metadata = folder / "mud_laws-1.0.dist-info"
    metadata.mkdir(parents=True)
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: mud-laws\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text("[runout.laws]\nherschel_bulkley = herschel_bulkley\n")
    (folder / "herschel_bulkley.py").write_text((EXAMPLES / "herschel_bulkley.py").read_text())
    return folder


@pytest.fixture
def installed_friction(tmp_path):
    """The same for a law of friction."""
    folder = tmp_path / "installed"
    metadata = folder / "weakening-1.0.dist-info"
    metadata.mkdir(parents=True)
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: weakening\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text("[runout.friction]\nvelocity_weakening = velocity_weakening\n")
    (folder / "velocity_weakening.py").write_text((EXAMPLES / "velocity_weakening.py").read_text())
    return folder
