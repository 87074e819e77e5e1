"""A scene without structures compiles and loads no code of structures: counted in a process of its own."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import pytest
from scenes import SAND

from runout import Coulomb
from runout.backends.protocol import get_backend
from runout.backends.scan.warm_up import side_wall, small_slope

HERE = Path(__file__).parent
COUNT = """
import gc, json, sys
from dataclasses import replace
from pathlib import Path

backend, structured = sys.argv[1], sys.argv[2] == "True"
from scenes import engine_of
from test_backends_agree import SCENE, slide

slide(engine_of(backend), SCENE if structured else replace(SCENE, structures=None), 2)
found = {"all": 0, "structures": 0}
if backend == "scan":
    from numba.core.dispatcher import Dispatcher

    every = [one for one in gc.get_objects() if isinstance(one, Dispatcher) and one.signatures]
    made = [Path(one.py_func.__code__.co_filename).stem for one in every]
else:
    import warp

    made = [name for name, module in warp._src.context.user_modules.items() if module.execs and name.startswith("runout")]
found["all"], found["structures"] = len(made), sum("structure" in name for name in made)
print(json.dumps(found))
"""


def counted(backend, structured):
    """Number of kernels (scan) or modules (hash) that a run compiled or loaded, in all and of structures."""
    path = os.pathsep.join([str(HERE), str(HERE.parent / "backends"), str(HERE.parents[1])])
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([path, os.environ.get("PYTHONPATH", "")])}
    command = [sys.executable, "-c", COUNT, backend, str(structured)]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.parametrize("backend", ["scan", "hash"])
def test_a_run_without_structures_compiles_no_code_of_structures(backend):
    bare, structured = counted(backend, False), counted(backend, True)
    assert bare["structures"] == 0
    assert bare["all"] > 0
    assert structured["structures"] > 0  # else nothing was counted
    assert structured["all"] > bare["all"]


def test_no_kernel_of_structures_runs_where_no_mass_is_near():
    slope, particles = small_slope((SAND,), (Coulomb(friction_angle=20.0),), "float64")
    slope = replace(slope, friction_zones=None)
    calls = []
    for origin in ((0.0, 0.0, -8.0), (4000.0, 4000.0, -8.0)):
        engine = get_backend("scan", threads=1)
        engine.load(replace(slope, structures=replace(side_wall(), origin=origin)), particles)
        with patch.object(engine.k, "find_structure_contacts", wraps=engine.k.find_structure_contacts) as find:
            for _ in range(3):
                engine.step(engine.stable_step())
        calls.append(find.call_count)
    assert calls == [3, 0]
