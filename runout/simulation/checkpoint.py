"""Checkpoint of a run: one file with its complete state, from which it continues to the same bits.

The file is an archive of plain arrays (.npz) beside a key of the inputs. It replaces the one before as a whole, and goes when the
run is complete. A checkpoint of other inputs, of other sources of runout or half written is not used: the run starts anew and says
so.
"""

import hashlib
import logging
import os
import time
import zipfile
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from runout.backends.protocol import Backend, ResumableBackend
from runout.backends.state import State
from runout.errors import ConfigError
from runout.io import source_code
from runout.io.atomic import whole_file
from runout.model.particle_source import ParticleSource
from runout.model.scene import Scene
from runout.quantities import member_map_names

LOGGER = logging.getLogger(__name__)
FORMAT = 14  # version of the file; increase it when the meaning of a state changes
EVERY = 120.0  # [s] between two checkpoints
# errors of a damaged archive; RuntimeError: it seems to be encrypted, or has an unknown compression
DAMAGED = (OSError, ValueError, KeyError, EOFError, MemoryError, RuntimeError, zipfile.BadZipFile, zlib.error)


@dataclass
class Checkpoint:
    """File with the latest checkpoint of one run."""

    path: Path  # the file; its folder is created if missing
    key: str  # key of the run, see :func:`run_key`
    every: float = EVERY  # wall time from one checkpoint to the next [s]
    written: int = field(default=0, init=False)  # number of checkpoints
    seconds: float = field(default=0.0, init=False)  # [s] spent on checkpoints
    last: float = field(default_factory=time.perf_counter, init=False)

    def due(self) -> bool:
        """Whether the next checkpoint is due."""
        return time.perf_counter() - self.last >= self.every

    def write(self, state: State) -> None:
        """Replace the checkpoint by a new state, completely or not at all; StorageError if it cannot be written."""
        started = time.perf_counter()
        with whole_file(self.path) as temporary, temporary.open("wb") as file:
            np.savez(file, key=np.array(self.key), **state)  # type: ignore[arg-type]
        self.last = time.perf_counter()
        self.written += 1
        self.seconds += self.last - started

    def read(self) -> State | None:
        """State to continue from; None if there is no file or it does not belong to this run."""
        if not self.path.is_file():
            return None
        try:
            with np.load(self.path, allow_pickle=False) as archive:
                if str(archive["key"]) == self.key:
                    return {name: archive[name] for name in archive.files if name != "key"}
            reason = "it belongs to other inputs or other sources of runout"
        except DAMAGED as error:
            reason = f"it cannot be read ({error})"
        LOGGER.warning("%s: checkpoint not used, %s; the run starts from time zero", self.path, reason)
        return None

    def remove(self) -> None:
        """Remove the file, if there is one."""
        self.path.unlink(missing_ok=True)


def stored_time(path: Path) -> float | None:
    """Simulated time [s] of the checkpoint in a file; None if it is missing or cannot be read."""
    try:
        with np.load(path, allow_pickle=False) as archive:
            return float(archive["run.time"])
    except DAMAGED:
        return None


def checkpoint_for(path: str | os.PathLike[str] | None, every: float, engine: Backend, key: str) -> Checkpoint | None:
    """Checkpoint of a run; None if none is requested or the backend does not support checkpoints."""
    if path is None:
        return None
    if not every >= 0:
        raise ConfigError(f"checkpoint_every is {every:g} s; it must be 0 or more")
    if isinstance(engine, ResumableBackend):
        return Checkpoint(Path(path), key, every)
    text = "%s: %s writes no checkpoints; an interrupted run starts from time zero (scan, hash and reference write them)"
    LOGGER.warning(text, path, type(engine).__name__)
    return None


class Content(Protocol):
    """Something that a run depends on."""

    def content(self) -> Iterable[np.ndarray]:
        """Arrays that determine it."""


def run_key(scene: Scene, particles: ParticleSource, *choices: Any, more: "Sequence[Content]" = ()) -> str:
    """Checksum of all that a run depends on.

    That is sources of runout, scene, particles, further choices with a complete ``repr``, and the contents of ``more``.
    """
    digest = hashlib.sha256(repr((FORMAT, source_code.checksums().members, np.__version__, member_map_names(), choices)).encode())
    ground = scene.ground
    plain = (scene.spacing, scene.raster, scene.materials, scene.friction, scene.gravity, scene.scheme())
    digest.update((scene.law.source + scene.basal.law.source).encode())
    lattice = ground and (ground.surface.spacing, ground.surface.origin, ground.first)
    digest.update(repr((plain, scene.contact_band, lattice)).encode())
    arrays = [ground.surface.coefficients, ground.change] if ground else []
    if scene.friction_zones:
        zones = scene.friction_zones
        changes_of_zones = [changes[name] for changes in (zones.replaced, zones.gridded) for name in sorted(changes)]
        arrays += [zones.factor, zones.coefficient, *chain.from_iterable(changes_of_zones)]
    if scene.unknown is not None:
        arrays += [scene.unknown]
    if scene.structures:
        field = scene.structures
        digest.update(repr((field.spacing, field.origin, field.band)).encode())
        arrays += [field.blocks, field.distance, field.patch, *vars(field.patches).values()]
    arrays += [scene.pore_table().view(np.uint8)]
    for values in chain(arrays, particles.content(), *(part.content() for part in more)):
        digest.update(np.ascontiguousarray(values).view(np.uint8).reshape(-1).data)
    return digest.hexdigest()
