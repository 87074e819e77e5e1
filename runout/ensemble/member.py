"""One member: what it is, the key of all that its result depends on, which names its files, and how it is run."""

import json
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING

from runout.ensemble.design import Design, member_table
from runout.errors import ConfigError, DiskFullError, RunoutError, StorageError
from runout.io import source_code
from runout.io.atomic import whole_file
from runout.io.provenance import checksum
from runout.log import of_member
from runout.quantities import member_map_names

if TYPE_CHECKING:
    from concurrent.futures import Future

    import pandas as pd

    from runout.config.site import Site
    from runout.simulation.result import Result

# sections of site.yaml that do not change what a member computes (its own parameters and seed are in the key)
NOT_IN_KEY = ("name", "title", "description", "metadata", "ensemble", "hazard", "observations", "report", "budget", "stability")
NAME_LENGTH = 16  # hexadecimal digits of a key: two of a million members share a name with probability 3e-8


@dataclass(frozen=True)
class Member:
    """One scenario of an ensemble."""

    number: int  # row of the table of members, from 0
    parameters: dict[str, float]  # sampled parameters in the units of ``site.yaml``
    seed: int  # seed of the particle sampling
    key: str  # checksum of everything that its result depends on

    @property
    def name(self) -> str:
        """Name of its files without suffix: a part of the key, so that equal members of all settings share them."""
        return self.key[:NAME_LENGTH]

    def file(self, results: Path) -> Path:
        """Where its result goes."""
        return members_folder(results) / f"{self.name}.nc"

    def failure_file(self, results: Path) -> Path:
        """Where the reason goes when it fails."""
        return failure_file(self.file(results))

    def checkpoint_file(self, results: Path) -> Path:
        """Where its checkpoint lies while it runs, or since it was broken off."""
        return members_folder(results) / f"{self.name}.checkpoint.npz"


def members_folder(results: Path) -> Path:
    """Folder of the members' files."""
    return Path(results) / "members"


def failure_file(file: Path) -> Path:
    """Where the reason goes when the member with a file fails."""
    return file.with_name(f"{file.stem}.failed.json")


def plan_members(site: "Site", design: Design | None = None) -> list[Member]:
    """All members of a site with their keys; those of a ``design`` if it is stated, else of the ensemble of site.yaml.

    Raises InputError if an input file cannot be read.
    """
    design = design or Design.of(site.settings.ensemble)
    common = _common_key(site)
    return [
        Member(i, p, s, checksum({"site": common, "parameters": p, "seed": s}))
        for i, (p, s) in enumerate(zip(design.samples(), design.seeds, strict=True))
    ]


def planned_table(site: "Site", members: int | None = None) -> "pd.DataFrame":
    """:func:`runout.ensemble.design.member_table` of a site with ``file``, the name of each member's file in ``members/``.

    ``members`` is the number of members that count, of an ensemble with a tolerance; all by default.
    """
    table = member_table(site.settings.ensemble, members)
    table["file"] = [f"{member.name}.nc" for member in plan_members(site)[:members]]
    return table


def _common_key(site: "Site") -> str:
    """Checksum of what all members share: input contents, configuration, sources of runout, maps in their files."""
    configuration = {k: v for k, v in site.computed().items() if k not in NOT_IN_KEY}
    made = {"sources": source_code.checksums().members, "maps": member_map_names()}
    return checksum({"inputs": site.files.checksums(), "configuration": configuration, **made})


def stored_key(path: Path) -> str | None:
    """Key that a member's file carries; None if there is no whole file."""
    from netCDF4 import Dataset

    from runout.io.netcdf import LOCK

    if not path.is_file():
        return None
    try:
        with LOCK, Dataset(path) as file:
            return str(file.getncattr("member_key"))
    except (OSError, AttributeError, RuntimeError):  # not NetCDF, or not of a member
        return None


def simulate_member(
    site: "Site",
    member: Member,
    results: Path,
    *,
    simulate: "Callable[..., Result] | None" = None,
    threads: int = 1,
    progress: Callable[[float], None] | None = None,
    device: str | None = None,
) -> None:
    """Simulate one member and write its file, whole or not at all; runs in a worker process.

    A member that was broken off half-way goes on from its checkpoint. ``simulate`` takes the place of :func:`runout.simulate`. It
    is importable by name, since it travels to other processes, and is given ``checkpoint`` and ``progress`` if it takes them.
    ``progress`` is called with the fraction of the member that is done, 0 to 1. ``device`` takes the place of the site's: one of
    several GPUs.
    """
    if stored_key(member.file(results)) == member.key:
        return  # finished just before its worker died, and handed out again
    from runout.forecast.step_cost import StepTimer

    if simulate is None:
        import runout

        simulate = runout.simulate
    arguments = {**site.member_arguments(member.parameters), "seed": member.seed, "threads": threads}
    if device is not None:
        arguments["device"] = device
    taken = signature(simulate).parameters
    timer = StepTimer(progress)
    offered = {"checkpoint": member.checkpoint_file(results), "progress": timer}
    with of_member(member.number):
        result = simulate(**arguments, **{name: value for name, value in offered.items() if name in taken})
    _write(site, member, result, results)
    timer.note(arguments, result)


def simulate_alone(
    site: "Site",
    members: tuple[Member, ...],
    results: Path,
    *,
    simulate: "Callable[..., Result] | None" = None,
    threads: int = 1,
    progress: Callable[[int, float], None],
    device: str | None = None,
) -> dict[int, BaseException]:
    """:func:`simulate_member` for each of some members; an error ends it."""
    for member in members:
        tell = partial(progress, member.number)
        simulate_member(site, member, results, simulate=simulate, threads=threads, progress=tell, device=device)
    return {}


def simulate_together(
    site: "Site", members: tuple[Member, ...], results: Path, *, progress: Callable[[int, float], None], device: str | None = None
) -> dict[int, BaseException]:
    """Simulate members in the launches of one device; write each one's file as soon as it ends, and return errors by number."""
    from concurrent.futures import ThreadPoolExecutor

    from runout.simulation.batch import simulate_batch

    todo = [m for m in members if stored_key(m.file(results)) != m.key]
    errors: dict[int, BaseException] = {}
    scenarios = []
    if todo:
        site.data()  # an input that cannot be used is no error of a member
    for member in list(todo):
        try:
            scenarios.append({**site.member_arguments(member.parameters), "seed": member.seed})
        except RunoutError as error:
            errors[member.number] = error
            todo.remove(member)
    place = device or site.settings.simulation.device

    def tell(k: int, fraction: float) -> None:
        progress(todo[k].number, fraction)

    with ThreadPoolExecutor(1) as writer:  # the device goes on meanwhile
        files: list[tuple[int, Future[None]]] = []  # by number of the member
        for k, outcome in simulate_batch(scenarios, device=place, progress=tell, particles=False):
            if isinstance(outcome, RunoutError):
                errors[todo[k].number] = outcome
            else:
                files.append((todo[k].number, writer.submit(_write, site, todo[k], outcome, results)))
            errors |= _unwritten([file for file in files if file[1].done()])
        errors |= _unwritten(files)
    return errors


def _unwritten(files: "Sequence[tuple[int, Future[None]]]") -> dict[int, BaseException]:
    """Errors by number of members whose file the netCDF library did not write; waits for them.

    Raises StorageError if no file can be written, so that nothing is simulated in vain.
    """
    errors: dict[int, BaseException] = {}
    for number, file in files:
        try:
            file.result()
        except StorageError as error:
            if isinstance(error, DiskFullError) or not isinstance(error.__cause__, RuntimeError):
                raise
            errors[number] = error
    return errors


def _write(site: "Site", member: Member, result: "Result", results: Path) -> None:
    """The file of a member, whole or not at all."""
    from runout.ensemble.work_log import log_work
    from runout.io.member_maps import seal
    from runout.io.netcdf import writing

    attributes = {
        "member_key": member.key,
        "parameters": json.dumps(member.parameters),
        "seed": member.seed,
        "site": site.name,
    }
    if stored_key(member.file(results)) == member.key:
        return  # another job has finished it meanwhile, and may have noted its checksum
    with whole_file(member.file(results)) as temporary:
        partly = "reached_only" in signature(result.to_netcdf).parameters  # results of other solvers may hold whole rasters
        result.to_netcdf(temporary, attrs=attributes, **({"reached_only": True} if partly else {}))
        with writing(member.file(results)):
            seal(temporary)
    log_work(member.number, getattr(result, "series", {}))


def member_range(text: str, members: int) -> range:
    """Members of a range ``first:end``, the end excluded; ``first:``, ``:end`` and a single number are ranges as well.

    Raises ConfigError if it is no range, holds no member, or reaches beyond the ``members`` of the ensemble.
    """
    stated = re.fullmatch(r"(\d{0,9})(:?)(\d{0,9})", text.strip(), re.ASCII)
    if not stated or not any(stated.group(1, 3)):
        raise ConfigError(f"--members {text[:80]}: this is no range; state first:end, such as 0:100 for the members 0 to 99")
    first = int(stated[1] or 0)
    end = int(stated[3] or members) if stated[2] else first + 1
    if not first < end <= members:
        why = "it holds no member" if first >= end and first < members else f"the ensemble has members 0 to {members - 1}"
        fix = f"; use {first}:{members}" if first < members < end else ""
        raise ConfigError(f"--members {text}: {why}{fix}")
    return range(first, end)
