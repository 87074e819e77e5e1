"""State of every member: done, failed with a reason, or left to do."""

from dataclasses import asdict, dataclass, field, replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING

from runout.ensemble.member import Member, members_folder, plan_members
from runout.ensemble.written import Found, Written, unused_files
from runout.errors import InputError, StabilityError
from runout.io.atomic import read_json, write_json

if TYPE_CHECKING:
    from runout.config.site import Site

# permanent failures; others may be due to memory, disk, device or a bug that has been fixed
LASTING = (InputError, StabilityError)
NOT_RUN = "not run yet"


class State(StrEnum):
    """State of a member."""

    DONE = "done"
    FAILED = "failed"
    LEFT = "left"


@dataclass(frozen=True)
class Failure:
    """Failure of a member."""

    member: int
    reason: str  # message for users
    type: str  # name of the error's class
    key: str  # key of the failed member; a member with another key is run again
    lasting: bool  # whether the failure is permanent; such a member is not run again
    parameters: dict[str, float] = field(default_factory=dict)
    seed: int = 0
    traceback: str = ""  # for errors that are bugs, else empty

    def write(self, path: Path) -> None:
        """Write the failure as JSON, completely or not at all."""
        write_json(asdict(self), path)

    @classmethod
    def read(cls, path: Path) -> "Failure | None":
        """Failure from a file; None if it is missing or cannot be read."""
        try:
            failure = cls(**read_json(path))
        except TypeError:  # the content is not a failure
            return None
        return failure if isinstance(failure.reason, str) and isinstance(failure.key, str) else None


def member_state(member: Member, results: Path, written: Written) -> tuple[State, str]:
    """State of a member and its reason (empty if done); ``written`` detects damaged files."""
    record = written.look(member.file(results))
    if record.key == member.key:
        return State.DONE, ""
    failure = Failure.read(member.failure_file(results))
    if failure and failure.key == member.key:
        return State.FAILED, failure.reason
    if member.checkpoint_file(results).exists():
        from runout.simulation.checkpoint import stored_time

        checkpoint_time = stored_time(member.checkpoint_file(results))
        if checkpoint_time is not None:
            return State.LEFT, f"broken off or running, kept at {checkpoint_time:.4g} s; a run goes on from there"
    return State.LEFT, _why_left(record)


def _why_left(record: Found) -> str:
    fault = record.fault or ("holds another member" if record.key else None)
    return f"its file {fault}; it is simulated again" if fault else NOT_RUN


@dataclass(frozen=True)
class Standing:
    """State of a member."""

    member: Member
    state: State
    reason: str  # empty when it is done


def standings(site: "Site", results: Path) -> list[Standing]:
    """State of every member of a site, in the order of their numbers."""
    written, members = Written(results), plan_members(site)
    if not members_folder(results).is_dir():  # avoids a search for files of each member
        return [Standing(member, State.LEFT, NOT_RUN) for member in members]
    states = [Standing(member, *member_state(member, results, written)) for member in members]
    if all(one.reason != NOT_RUN for one in states) or not unused_files(results, members):
        return states
    return [replace(one, reason=f"{NOT_RUN} with these inputs and settings") if one.reason == NOT_RUN else one for one in states]
