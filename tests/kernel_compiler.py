"""Compiles the kernels of scan for all tests, in one process for each number type, which the workers of pytest share.

Half of the compilation of a variant is that of functions which its kernels inline. A process that has compiled one variant
has most of them for the next, and two workers do not compile the same kernels for two variants at the same time. The cache
holds the same code as from a process for each variant.
"""

import os
import subprocess
import tempfile
from multiprocessing.connection import Client, Listener

import locket

from runout.backends.scan import precompile
from runout.processes.lifetime import end_with_parent, python_command

COMPILED = "compiled"


class KernelCompiler:
    """Processes that compile one variant after another.

    Parameters
    ----------
    in_own_process : callable
        Compiles one variant in a process of its own. It is called where these processes fail, and for another cache.
    folder : pathlib.Path
        Of their sockets and locks; the same for all workers.
    """

    def __init__(self, in_own_process, folder):
        self.in_own_process, self.folder, self.root = in_own_process, folder, precompile.cache_root()
        self.started = []

    def __call__(self, scene, kind):
        """Whether the kernels of a kind of scene are compiled."""
        if precompile.cache_root() != self.root:
            return self.in_own_process(scene, kind)
        socket = str(self.folder / scene.precision)
        with locket.lock_file(f"{socket}.lock"), tempfile.TemporaryDirectory(prefix="runout-") as shared:
            try:
                answer = self._answer(socket, precompile.job_of(scene, kind, shared))
            except (OSError, EOFError) as error:  # the process has ended, or the name of the socket is too long
                answer = repr(error)
            return answer == COMPILED or self.in_own_process(scene, kind)

    def _answer(self, socket, job):
        try:
            connection = Client(socket)
        except (FileNotFoundError, ConnectionRefusedError):
            self._start(socket)
            connection = Client(socket)
        with connection:
            connection.send(job)
            return connection.recv()

    def _start(self, socket):
        if os.path.exists(socket):
            os.unlink(socket)  # of a process that has ended with its worker
        command = python_command(f"from kernel_compiler import serve; serve({socket!r}, {os.getpid()})")
        process = subprocess.Popen(
            command, env=precompile.environment_of_compilation(), stdout=subprocess.PIPE, start_new_session=True, text=True
        )
        self.started.append(process)
        process.stdout.readline()  # written when it listens

    def end(self):
        """End the processes that this worker has started."""
        for process in self.started:
            process.kill()
            process.communicate()


def serve(socket, parent):
    """Compile for each job that comes through a socket; the answer is COMPILED, or the reason where it failed."""
    end_with_parent(parent)
    from runout.backends.scan import warm_up

    warm_up.end_with_parent = lambda parent: None  # that of a job may be another worker
    with Listener(socket) as listener:
        print("listens", flush=True)
        while True:
            with listener.accept() as connection:
                os.environ[precompile.WARM_UP] = connection.recv()
                try:
                    warm_up.warm_up()
                    connection.send(COMPILED)
                except Exception as error:  # noqa: BLE001 - the answer is the reason
                    connection.send(repr(error))
