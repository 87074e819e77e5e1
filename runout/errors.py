"""Errors that runout raises at its boundary: each names the place, the offending value and the remedy."""

from dataclasses import dataclass
from enum import IntEnum, StrEnum
from types import UnionType
from typing import Any, TypeVar

Choice = TypeVar("Choice", bound=StrEnum)


class ExitCode(IntEnum):
    """Exit codes of the commands."""

    OK = 0
    FAILURE = 1
    CONFIGURATION = 2
    PARTIAL_ENSEMBLE = 3
    OVER_BUDGET = 4


class RunoutError(Exception):
    """Base of all errors that a user can remedy; commands print the text without a traceback."""

    exit_code = ExitCode.FAILURE


class InputError(RunoutError):
    """An input that must be corrected before a run."""

    exit_code = ExitCode.CONFIGURATION


class DemError(InputError):
    """An elevation raster that cannot be used."""


class ReleaseError(InputError):
    """A release that cannot be used."""


class ZoneError(InputError):
    """Friction zones that cannot be used."""


class ObservationError(InputError):
    """Observations or products that cannot be scored or compared."""


class MaterialError(InputError):
    """Material parameters out of their range."""


def member_of(kind: type[Choice], value: Any, name: str, error: type[InputError]) -> Choice:
    """Member of an enumeration with this value; otherwise ``error`` names the quantity and lists the valid values."""
    try:
        return kind(value)
    except ValueError:
        raise error(f"{name} is {value!r}; choose one of {', '.join(kind)}") from None


def require_kind(kind: type | UnionType, value: Any, name: str, remedy: str, error: type[InputError]) -> None:
    """Raise ``error``, which names the argument, its value and the remedy, unless a value is of a kind."""
    if not isinstance(value, kind):
        raise error(f"{name} is {repr(value)[:80]}; {remedy}")


@dataclass(frozen=True)
class Problem:
    """One problem of a configuration, with its place and its remedy."""

    file: str
    line: int | None
    key: str
    message: str
    fix: str = ""

    def __str__(self) -> str:
        place = f"{self.file}:{self.line}" if self.line else self.file
        key = f" {self.key}:" if self.key else ""
        return f"{place}:{key} {self.message}" + (f"; {self.fix}" if self.fix else "")


class ConfigError(InputError):
    """A configuration with one or more problems; all of them are listed at once."""

    def __init__(self, problems: list[Problem] | str):
        self.problems = [] if isinstance(problems, str) else list(problems)
        super().__init__(problems if isinstance(problems, str) else "\n".join(map(str, self.problems)))


class StructureError(InputError):
    """Structures that cannot be used; all their problems are listed at once."""

    def __init__(self, problems: list[str] | str):
        self.problems = [] if isinstance(problems, str) else list(problems)
        super().__init__(problems if isinstance(problems, str) else "\n".join(problems))


class StabilityError(RunoutError):
    """A run that is or would become unstable."""


class CapacityError(RunoutError):
    """A scene that exceeds the index range or the memory; states the limit."""

    exit_code = ExitCode.OVER_BUDGET


class BudgetError(RunoutError):
    """A plan that exceeds the budget stated in the site's configuration."""

    exit_code = ExitCode.OVER_BUDGET


class DeviceError(RunoutError):
    """A device that does not exist or cannot be used."""


class DeviceNameError(DeviceError):
    """A name that no device can have."""

    exit_code = ExitCode.CONFIGURATION


class LibraryError(RunoutError):
    """A library of an optional extra that is not installed or cannot be imported; states the command that installs it."""


class RenderError(RunoutError):
    """A picture or film that cannot be made; results do not depend on it."""


class ClusterError(RunoutError):
    """A cluster that cannot be reached, or whose workers cannot compute members."""


class StorageError(RunoutError):
    """A file or cache that cannot be written or read."""


class DiskFullError(StorageError):
    """A disk or quota without space for a file."""


class PartialEnsembleError(RunoutError):
    """An ensemble of which some members failed."""

    exit_code = ExitCode.PARTIAL_ENSEMBLE
