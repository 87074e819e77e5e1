"""What has become of every member: done, failed with its reason, or left to do."""

from dataclasses import asdict, dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING

from runout.checkpoint import stored_time
from runout.ensemble.member import Member, members_folder, plan_members
from runout.ensemble.written import Found, Written
from runout.errors import InputError, StabilityError
from runout.io.atomic import read_json, write_json

if TYPE_CHECKING:
    import pandas as pd

    from runout.config.site import Site

# these would fail again on any machine; every other failure may be due to memory, disk, device or a mended bug
LASTING = (InputError, StabilityError)


class State(StrEnum):
    """State of a member."""

    DONE = "done"
    FAILED = "failed"
    LEFT = "left"


@dataclass(frozen=True)
class Failure:
    """Why a member failed.

    Attributes
    ----------
    member : int
    reason : str
        What a user reads.
    type : str
        Name of the error's class.
    key : str
        Key of the member that failed; a member with another key is tried anew.
    lasting : bool
        True if it would fail again on any machine, so that it is not tried again.
    parameters : dict of str to float
    seed : int
    traceback : str
        For errors that are bugs, else empty.
    """

    member: int
    reason: str
    type: str
    key: str
    lasting: bool
    parameters: dict[str, float] = field(default_factory=dict)
    seed: int = 0
    traceback: str = ""

    def write(self, path: Path) -> None:
        """Write it as JSON, whole."""
        write_json(asdict(self), path)

    @classmethod
    def read(cls, path: Path) -> "Failure | None":
        """The failure of a file; None if there is none that can be read."""
        try:
            found = cls(**read_json(path))
        except TypeError:  # no failure
            return None
        return found if isinstance(found.reason, str) and isinstance(found.key, str) else None


def member_state(member: Member, results: Path, written: Written) -> tuple[State, str]:
    """State of a member and its reason (empty when done); ``written`` tells a file that was damaged since."""
    found = written.look(member.file(results))
    if found.key == member.key:
        return State.DONE, ""
    failure = Failure.read(member.failure_file(results))
    if failure and failure.key == member.key:
        return State.FAILED, failure.reason
    kept = stored_time(member.checkpoint_file(results))
    if kept is not None:
        return State.LEFT, f"broken off or running, kept at {kept:.4g} s; a run goes on from there"
    return State.LEFT, _why_left(found, failure)


def _why_left(found: Found, failure: Failure | None) -> str:
    if found.fault:
        return f"its file {found.fault}; it is simulated again"
    return "inputs, settings or parameters changed since it was run" if found.key or failure else "not run yet"


def member_status(site: "Site", results: Path) -> "pd.DataFrame":
    """Table of all members: their parameters, ``state`` (done, failed, left) and ``reason``; indexed by ``member``."""
    import pandas as pd

    members, written = plan_members(site), Written(results)
    begun = members_folder(results).is_dir()  # else nothing is looked for, member by member
    states = [member_state(m, results, written) if begun else (State.LEFT, "not run yet") for m in members]
    table = pd.DataFrame([m.parameters for m in members], index=pd.Index([m.number for m in members], name="member"))
    table["state"] = [str(state) for state, _ in states]
    table["reason"] = [reason for _, reason in states]
    return table
