"""Compiles the kernels of scan for all tests of a worker of pytest in one process.

Half of the compilation of a variant is that of functions which its kernels inline. A process that has compiled one variant
has most of them for the next. The cache holds the same code as from a process for each variant.
"""

import os
import subprocess
import sys
import tempfile
import threading

from runout.backends.scan import precompile
from runout.processes.lifetime import end_with_parent, python_command

COMPILED = "compiled"


class KernelCompiler:
    """A process that compiles one variant after another.

    Parameters
    ----------
    in_own_process : callable
        Compiles one variant in a process of its own. It is called where this process fails, and for another cache.
    """

    def __init__(self, in_own_process):
        self.in_own_process, self.root = in_own_process, precompile.cache_root()
        self.process, self.lock = None, threading.Lock()

    def __call__(self, scene, kind):
        """Whether the kernels of a kind of scene are compiled."""
        if precompile.cache_root() != self.root:
            return self.in_own_process(scene, kind)
        with self.lock, tempfile.TemporaryDirectory(prefix="runout-") as folder:
            return self._answer(precompile.job_of(scene, kind, folder)) == COMPILED or self.in_own_process(scene, kind)

    def _answer(self, job):
        if self.process is None or self.process.poll() is not None:
            command = python_command(f"from kernel_compiler import serve; serve({os.getpid()})")
            self.process = subprocess.Popen(
                command, env=precompile.environment_of_compilation(), stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                start_new_session=True, text=True,
            )  # fmt: skip
        try:
            self.process.stdin.write(f"{job}\n")
            self.process.stdin.flush()
        except BrokenPipeError:
            return ""
        return self.process.stdout.readline().strip()

    def end(self):
        """End the process."""
        if self.process is not None:
            self.process.kill()
            self.process.communicate()


def serve(parent):
    """Compile for each job on a line of the standard input; the answer is a line, the reason where it failed."""
    end_with_parent(parent)
    from runout.backends.scan import warm_up

    for job in sys.stdin:
        os.environ[precompile.WARM_UP] = job.strip()
        try:
            warm_up.warm_up()
            print(COMPILED, flush=True)
        except Exception as error:  # noqa: BLE001 - the answer is the reason
            print(repr(error).replace("\n", " "), flush=True)
