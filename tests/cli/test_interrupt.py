"""Ctrl-C at any moment: one line, exit code 130, no process and no half file left."""

import os
import signal
import subprocess
import sys
import textwrap
import time

import psutil
import pytest

import runout

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
LINE = "error: interrupted; finished work is kept, the same command continues\n"
START = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"  # ignored in the background of a shell
MOMENTS = {
    "libraries are loaded": """
        import builtins
        load = builtins.__import__
        def slow(name, *rest):
            if name == "cyclopts": wait()
            return load(name, *rest)
        builtins.__import__ = slow
    """,
    "an exception would be lost": """
        import runout.workflow.hazard_map as study
        def lossy(*_, **__):
            try: wait()
            except BaseException: pass
            time.sleep(60)
        study.run = lossy
    """,
    "a thread computes": """
        import threading, runout.workflow.hazard_map as study
        def run(*_, **__):
            thread = threading.Thread(target=wait); thread.start(); thread.join()
        study.run = run
    """,
    "a file is written": """
        from dataclasses import dataclass
        from pathlib import Path
        import runout.workflow.hazard_map as study
        from runout.io.atomic import whole_file
        def write(study, *_):
            with whole_file(study.results / "maps" / "a.tif") as temporary:
                temporary.write_text("half")
                wait()
        @dataclass
        class Study: results: Path; cluster: object = None
        study.Study.open = lambda *_, **__: Study(Path(sys.argv[2]) / "results")
        study._run = write
    """,
    "a worker process computes": """
        from dataclasses import dataclass
        from pathlib import Path
        import runout.workflow.hazard_map as study
        from runout.ensemble.worker import packed, start_worker
        def run(study, *_):
            workers = [start_worker(k, None) for k in range(2)]
            for worker in workers: worker.assign(packed(time.sleep)), worker.hear(), worker.give(60)
            wait()
        @dataclass
        class Study: results: Path; cluster: object = None
        study.Study.open = lambda *_, **__: Study(Path(sys.argv[2]) / "results")
        study._run = run
    """,
    "kernels are compiled": """
        import runout.workflow.hazard_map as study, runout.backends.scan.precompile as ahead
        from runout.processes.lifetime import interrupts_kept
        def run(*_, **__):
            with interrupts_kept():
                watched = "import os, time, runout.processes.lifetime as life; life.end_with_parent(os.getppid()); time.sleep(60)"
                child = subprocess.Popen([sys.executable, "-c", watched])
            threading.Timer(0.5, print, ["now"], {"flush": True}).start()
            ahead._ended(child)
        study.run = run
    """,
}


def started(folder, moment):
    program = START + "import subprocess, sys, threading, time\ndef wait():\n    print('now', flush=True)\n    time.sleep(60)\n"
    program += textwrap.dedent(MOMENTS[moment]) + "from runout.__main__ import main\nsys.exit(main())"
    command = [sys.executable, "-c", program, "run", str(folder)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True)


@pytest.mark.parametrize("moment", MOMENTS)
def test_an_interrupt_is_one_line_while(tmp_path, moment):
    process = started(tmp_path, moment)
    assert process.stdout.readline() == "now\n"
    children = psutil.Process(process.pid).children(recursive=True)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does
    _, said = process.communicate(timeout=20)
    assert (process.returncode, said) == (130, LINE)
    assert psutil.wait_procs(children, timeout=3)[1] == []
    assert not list(tmp_path.rglob("*.part"))


LOADED = """
    import os, signal, sys
    signal.signal(signal.SIGINT, signal.default_int_handler)
    class Interrupting:
        def find_spec(name, path=None, target=None):
            if name == WHEN: os.kill(os.getpid(), signal.SIGINT)
    for name in [name for name in sys.modules if name.split(".")[0] == WHEN]: del sys.modules[name]
    sys.meta_path.insert(0, Interrupting)
    sys.argv = ["/usr/bin/runout", "doctor"]
    from runout.__main__ import main
    sys.exit(main())
"""


@pytest.mark.parametrize("module", ["typing", "runout.__main__", "runout.cli", "runout.errors", "contextlib", "cyclopts", "rich"])
def test_an_interrupt_is_one_line_while_it_loads(module):
    program = f"WHEN = {module!r}\n" + textwrap.dedent(LOADED)
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=20, check=False)
    assert (done.returncode, done.stderr) == (130, LINE)


@pytest.mark.parametrize("delay", [0.01, 0.03, 0.06, 0.1, 0.15, 0.2, 0.3, 0.5, 0.8, 1.0])
def test_an_interrupt_is_one_line_whenever_runout_has_begun(tmp_path, delay):
    script = tmp_path / "runout"  # as installers write it
    script.write_text("import re, sys\nfrom runout.__main__ import main\nsys.exit(main())\n")
    process = subprocess.Popen(
        [sys.executable, str(script), "doctor"], preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    time.sleep(delay)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=60)
    package = os.path.join(os.path.dirname(runout.__file__), "")  # not the folder of the checkout, which may have that name
    begun = [line for line in said.splitlines() if f'File "{package}' in line]
    assert begun == []  # before the first line of runout Python itself answers, with a frame of its own start at most
    assert "Traceback" in said or process.returncode in (0, 1, -signal.SIGINT) or (process.returncode, said) == (130, LINE)


def test_a_program_that_imports_the_package_keeps_its_own_interrupt():
    program = START + "import runout, signal; print(signal.getsignal(signal.SIGINT) is signal.default_int_handler)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=20, check=True)
    assert done.stdout == "True\n"


def test_a_request_to_end_is_one_line_too(tmp_path):
    process = started(tmp_path, "a file is written")
    process.stdout.readline()
    process.terminate()
    _, said = process.communicate(timeout=20)
    assert (process.returncode, said) == (143, LINE.replace("interrupted", "terminated"))
    assert not list(tmp_path.rglob("*.part"))


def test_an_interrupt_that_is_ignored_stays_ignored():
    process = subprocess.Popen(
        [
            sys.executable,
            "-c",
            "import time\nfrom runout.processes.interrupt import end_at_once\n"
            "end_at_once()\nprint('now', flush=True)\ntime.sleep(1)",
        ],
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_IGN),
        stdout=subprocess.PIPE,
    )
    process.stdout.readline()
    time.sleep(0.1)
    process.send_signal(signal.SIGINT)
    assert process.wait(20) == 0
