"""Commands sbatch and scancel that run job scripts on this machine, for tests of SLURM jobs."""

import sys

SBATCH = """\
#!{python}
import os, shutil, subprocess, sys
from pathlib import Path
here = Path(__file__).parent
script = here / f"job-{{os.getpid()}}.sh"
shutil.copy(sys.argv[-1], script)
with open(script.with_suffix(".log"), "w") as log:
    job = subprocess.Popen(["bash", str(script)], stdin=subprocess.DEVNULL, stdout=log, stderr=log, start_new_session=True)
(here / f"submitted-{{job.pid}}").touch()
print(f"Submitted batch job {{job.pid}}")
"""
SCANCEL = """\
#!{python}
import os, signal, sys
from pathlib import Path
for job in sys.argv[1:]:
    (Path(__file__).parent / f"cancelled-{{job}}").touch()
    try:
        os.killpg(int(job), signal.SIGKILL)
    except ProcessLookupError:
        pass
"""


def install(folder):
    """Folder with the two commands, to be put on PATH."""
    folder.mkdir()
    for name, text in (("sbatch", SBATCH), ("scancel", SCANCEL)):
        (folder / name).write_text(text.format(python=sys.executable))
        (folder / name).chmod(0o755)
    return folder
