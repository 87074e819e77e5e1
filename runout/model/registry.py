"""Registries of laws, each in a file of its own, in runout or in another package.

In runout, each module of a folder has the name of the law that it registers. Another package declares an entry point of that name,
or a Python program imports the module. A module is imported when its law is found by name, so that a broken package affects only
its users. A site file cannot name code.
"""

import importlib
import pkgutil
import sys
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from inspect import isclass
from types import ModuleType
from typing import Any, Generic, TypeVar

from runout.processes.imports import show_dask

Entry = TypeVar("Entry")


class Registry(Generic[Entry]):
    """Entries by name.

    Modules of ``package`` and entry points of the ``group`` of other packages register entries. ``kind`` is what messages call an
    entry, such as "material law"; ``error`` makes the error of a message.
    """

    def __init__(self, kind: str, package: str, group: str, error: Callable[[str], Exception]):
        self.kind, self.package, self.group, self.error = kind, package, group, error
        self._entries: dict[str, tuple[str, Entry]] = {}  # by name: module and class, and the entry

    def add(self, name: str, home: str, entry: Entry) -> None:
        """Register an entry.

        ``home``: module and class of the entry; the same home may register again. Raises ``error`` if an entry of another home has
        the name.
        """
        owner = f"{self.package}.{name}" if name in modules_of(self.package) else self._entries.get(name, (home,))[0]
        if home != owner and not home.startswith(f"{owner}."):
            raise self.error(f"{self.kind} {name}: {home} and {owner} have the same name; choose another one")
        self._entries[name] = home, entry

    def names(self) -> tuple[str, ...]:
        """Names that :meth:`find` accepts, those of runout first; imports nothing."""
        outside = [entry.name for entry in _declared(tuple(sys.path)).select(group=self.group)]
        return tuple(dict.fromkeys([*modules_of(self.package), *self._entries, *outside]))

    def find(self, name: str) -> Entry:
        """The entry of a name; imports its module if necessary.

        Raises the given error if there is none, two packages have one, or the package cannot be imported.
        """
        if name not in self._entries and name in modules_of(self.package):
            importlib.import_module(f"{self.package}.{name}")
        elif name not in self._entries:
            self._import_from_outside(name)
        if name not in self._entries:
            raise self.error(f"{self.kind} {name}: its module registers none of that name; the names must be the same")
        return self._entries[name][1]

    def all(self) -> tuple[Entry, ...]:
        """All entries; imports their modules."""
        return tuple(self.find(name) for name in self.names())

    def of_runout(self) -> tuple[Entry, ...]:
        """The entries of the package."""
        return tuple(self.find(name) for name in modules_of(self.package))

    def known(self) -> tuple[Entry, ...]:
        """The entries of runout, and those of other packages that are imported."""
        return (*self.of_runout(), *(entry for name, (_, entry) in self._entries.items() if name not in modules_of(self.package)))

    def _import_from_outside(self, name: str) -> None:
        entries = list(dict.fromkeys(_declared(tuple(sys.path)).select(group=self.group, name=name)))
        if not entries:
            raise self.error(f"{name!r} is no {self.kind}; choose one of {', '.join(self.names())}")
        if len(entries) > 1:
            raise self.error(f"{self.kind} {name}: {' and '.join(map(_origin, entries))} both have one; uninstall one of them")
        show_dask()  # its package may need it
        try:
            entries[0].load()
        except Exception as error:
            reason = f"{type(error).__name__}: {error}"
            raise self.error(f"{self.kind} {name} of {_origin(entries[0])}: {reason}; mend or uninstall that package") from error


@cache
def modules_of(package: str) -> tuple[str, ...]:
    """Names of the modules of a package, sorted."""
    return tuple(sorted(module.name for module in pkgutil.iter_modules(importlib.import_module(package).__path__)))


def parts_of(package: str, first: Sequence[str] = ()) -> list[ModuleType]:
    """Imported modules of a package whose files each add something: those named ``first``, then the others by name."""
    names = [*first, *(name for name in modules_of(package) if name not in first)]
    return [importlib.import_module(f"{package}.{name}") for name in names]


@cache
def _declared(path: tuple[str, ...]) -> Any:
    """Entry points of all packages on the search ``path`` of this process; to read them opens a file of every package."""
    return entry_points()


def classes_in(homes: Iterable[str]) -> dict[str, str]:
    """Module of each class that imported modules define, by its name."""
    classes = [(home, value) for home in homes for value in vars(sys.modules[home]).values() if isclass(value)]
    return {value.__name__: home for home, value in classes if value.__module__ == home}


def _origin(entry: EntryPoint) -> str:
    """The package that an entry point belongs to."""
    return f"{entry.dist.name} {entry.dist.version}" if entry.dist else entry.value
