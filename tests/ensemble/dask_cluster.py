"""A dask cluster of processes on this machine, with certificates of its own, for tests."""

import datetime
import ipaddress
import os
import socket
import subprocess
import sys
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import psutil
import pytest
from ensemble_fakes import wait_until

pytest.importorskip("distributed", reason="distributed is not installed")
pytest.importorskip("cryptography", reason="cryptography is not installed")
HERE = Path(__file__).parent
ROOT = HERE.parent.parent


def certificates(folder, name="here"):
    """Files of a new certificate that signed itself, and of its key: authority, certificate, key."""
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec

    key, now = ec.generate_private_key(ec.SECP256R1()), datetime.datetime.now(datetime.UTC)
    subject = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, name)])
    names = x509.SubjectAlternativeName([x509.IPAddress(ipaddress.ip_address("127.0.0.1"))])
    builder = x509.CertificateBuilder(subject, subject, key.public_key(), x509.random_serial_number())
    builder = builder.not_valid_before(now - datetime.timedelta(hours=1)).not_valid_after(now + datetime.timedelta(hours=9))
    signed = builder.add_extension(names, critical=False).sign(key, hashes.SHA256())
    cert, secret = folder / f"{name}.pem", folder / f"{name}.key"
    cert.write_bytes(signed.public_bytes(serialization.Encoding.PEM))
    form = serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    secret.write_bytes(key.private_bytes(serialization.Encoding.PEM, *form))
    return {"tls_ca": cert, "tls_cert": cert, "tls_key": secret}


@dataclass
class Processes:
    """Scheduler and workers of a cluster; ``address`` is that of the scheduler."""

    folder: Path
    tls: dict = field(default_factory=dict)
    address: str = ""
    running: list = field(default_factory=list)

    def start(self, kind, *options, path=(HERE, ROOT)):
        """Start a process of dask that finds modules in ``path``; its messages go to a file."""
        flags = {"tls_ca": "--tls-ca-file", "tls_cert": "--tls-cert", "tls_key": "--tls-key"}
        tls = [f"{flags[name]}={path}" for name, path in self.tls.items()]
        found = os.pathsep.join([*map(str, path), os.environ.get("PYTHONPATH", "")])
        command = [sys.executable, "-m", f"distributed.cli.dask_{kind}", *options, *tls]
        environment = {**os.environ, "PYTHONPATH": found}
        with open(self.folder / f"{kind}-{len(self.running)}.log", "w") as log:
            process = subprocess.Popen(command, env=environment, cwd=self.folder, stdout=log, stderr=log, start_new_session=True)
        self.running.append(process)
        return process

    def worker(self, threads, *options, **choices):
        """Start a worker; dask starts it anew when it dies, unless ``--no-nanny`` is among the options."""
        return self.start("worker", self.address, f"--nthreads={threads}", "--no-dashboard", *options, **choices)

    def end(self):
        """End all processes, with those that they started."""
        for process in self.running:
            end(process)


def end(process):
    """Kill a process and those that it started, unless it has ended: its number may be that of another process now."""
    if process.poll() is not None:
        return
    with suppress(psutil.NoSuchProcess):
        for child in psutil.Process(process.pid).children(recursive=True):
            with suppress(psutil.NoSuchProcess):
                child.kill()
    process.kill()
    process.wait()


def _free_port():
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


@contextmanager
def cluster(folder, *, tls=True):
    """Context of a scheduler without workers."""
    folder.mkdir(exist_ok=True)
    made, port = Processes(folder, certificates(folder) if tls else {}), _free_port()
    made.address = f"{'tls' if tls else 'tcp'}://127.0.0.1:{port}"
    try:
        made.start("scheduler", "--host", made.address, "--no-dashboard", "--no-show")
        wait_until(lambda: _answers(port))
        yield made
    finally:
        made.end()


def _answers(port):
    with socket.socket() as one:
        return one.connect_ex(("127.0.0.1", port)) == 0
