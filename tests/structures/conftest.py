"""Every test of this folder runs on each backend that is there."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "backends"))
