"""The site and the ensemble of other tests, importable here."""

import sys
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parents[1] / name) for name in ("workflow", "hazard")]
