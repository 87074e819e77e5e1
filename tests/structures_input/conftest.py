"""Fixtures of the tests of structures."""

import sys
from pathlib import Path

import numpy as np
import pytest

from runout.model.terrain import Terrain

sys.path.append(str(Path(__file__).parent))
from structure_bodies import SOUTH, WEST


@pytest.fixture(scope="session")
def level():
    """Level ground at elevation 100 m, 200 x 200 m in cells of 5 m, far from the origin of the map."""
    return Terrain(np.full((40, 40), 100.0), (5.0, 5.0), WEST, SOUTH, "EPSG:32632")
