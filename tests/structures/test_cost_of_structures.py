"""A scene without structures compiles and loads no code of structures: counted in a process of its own."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

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
    environment = {**os.environ, "PYTHONPATH": path}
    command = [sys.executable, "-c", COUNT, backend, str(structured)]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.parametrize("backend", ["scan", "hash"])
def test_a_run_without_structures_compiles_no_code_of_structures(backend):
    if backend == "hash":
        pytest.importorskip("warp")
    bare, structured = counted(backend, False), counted(backend, True)
    assert bare["structures"] == 0
    assert bare["all"] > 0
    assert structured["structures"] > 0  # else nothing was counted
    assert structured["all"] > bare["all"]
