"""Errors that runout raises at its boundary: each names the place, the offending value and the remedy."""

from dataclasses import dataclass
from enum import IntEnum, StrEnum
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
    """Base of every error that a user can mend; commands print its text without a traceback."""

    exit_code = ExitCode.FAILURE


class InputError(RunoutError):
    """An input that has to be mended before anything runs."""

    exit_code = ExitCode.CONFIGURATION


class DemError(InputError):
    """An elevation raster that cannot be used as it is."""


class ReleaseError(InputError):
    """A release that cannot be used as it is."""


class ZoneError(InputError):
    """Friction zones of the ground that cannot be used as they are."""


class MaterialError(InputError):
    """Material parameters out of their range."""


def member_of(kind: type[Choice], value: Any, name: str, error: type[InputError]) -> Choice:
    """The member of an enumeration that has a value; ``error`` names the quantity and lists the values."""
    try:
        return kind(value)
    except ValueError:
        raise error(f"{name} is {value!r}; choose one of {', '.join(kind)}") from None


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


class StabilityError(RunoutError):
    """A run that is or would become unstable."""


class CapacityError(RunoutError):
    """A scene that does not fit: index range or memory; states the largest that does."""

    exit_code = ExitCode.OVER_BUDGET


class BudgetError(RunoutError):
    """A plan that exceeds the budget stated in the site's configuration."""

    exit_code = ExitCode.OVER_BUDGET


class DeviceError(RunoutError):
    """A device that is not there or cannot be used."""


class StorageError(RunoutError):
    """A file or cache that cannot be written or read."""


class DiskFullError(StorageError):
    """A disk or quota without space for what has to be written."""


class PartialEnsembleError(RunoutError):
    """An ensemble of which some members failed."""

    exit_code = ExitCode.PARTIAL_ENSEMBLE
