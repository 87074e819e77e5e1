"""Registries: what can be added in a file of its own, from inside the package or from outside.

Inside, every module of one folder is found by its name, which is the name of what it registers. Outside, an installed package names
its module under an entry point of that name, or a Python program imports the module. Nothing is imported before it is asked for by
name, so that a broken package harms only those who use it. No file of a site can name code.
"""

import importlib
import pkgutil
import sys
from collections.abc import Callable, Iterable
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from inspect import isclass
from typing import Generic, TypeVar

Entry = TypeVar("Entry")


class Registry(Generic[Entry]):
    """Entries by name.

    Parameters
    ----------
    kind : str
        What an entry is, in messages.
    package : str
        Folder of those of runout.
    group : str
        Entry points of those of other packages.
    error : callable
        Makes the error of a message.
    """

    def __init__(self, kind: str, package: str, group: str, error: Callable[[str], Exception]):
        self.kind, self.package, self.group, self.error = kind, package, group, error
        self._entries: dict[str, tuple[str, Entry]] = {}  # by name: where it comes from, and the entry

    def add(self, name: str, home: str, entry: Entry) -> None:
        """Register an entry that comes from ``home``, its module and class; the same home may register anew.

        Raises
        ------
        error
            If another one has the name.
        """
        owner = f"{self.package}.{name}" if name in modules_of(self.package) else self._entries.get(name, (home,))[0]
        if home != owner and not home.startswith(f"{owner}."):
            raise self.error(f"{self.kind} {name}: {home} and {owner} have the same name; choose another one")
        self._entries[name] = home, entry

    def names(self) -> tuple[str, ...]:
        """Names that :meth:`find` knows, those of runout first; nothing is imported."""
        outside = [entry.name for entry in entry_points(group=self.group)]
        return tuple(dict.fromkeys([*modules_of(self.package), *self._entries, *outside]))

    def find(self, name: str) -> Entry:
        """The entry of a name, imported if need be.

        Raises
        ------
        error
            If there is none, two packages have one, or the package cannot be imported.
        """
        if name not in self._entries and name in modules_of(self.package):
            importlib.import_module(f"{self.package}.{name}")
        elif name not in self._entries:
            self._import_from_outside(name)
        if name not in self._entries:
            raise self.error(f"{self.kind} {name}: its module registers none of that name; the names must be the same")
        return self._entries[name][1]

    def all(self) -> tuple[Entry, ...]:
        """Every entry, all of them imported."""
        return tuple(self.find(name) for name in self.names())

    def of_runout(self) -> tuple[Entry, ...]:
        """The entries of the package."""
        return tuple(self.find(name) for name in modules_of(self.package))

    def known(self) -> tuple[Entry, ...]:
        """The entries of the package and those of others that are imported."""
        return (*self.of_runout(), *(entry for name, (_, entry) in self._entries.items() if name not in modules_of(self.package)))

    def _import_from_outside(self, name: str) -> None:
        found = list(dict.fromkeys(entry_points(group=self.group, name=name)))
        if not found:
            raise self.error(f"{name!r} is no {self.kind}; choose one of {', '.join(self.names())}")
        if len(found) > 1:
            raise self.error(f"{self.kind} {name}: {' and '.join(map(_origin, found))} both have one; uninstall one of them")
        try:
            found[0].load()
        except Exception as error:
            said = f"{type(error).__name__}: {error}"
            raise self.error(f"{self.kind} {name} of {_origin(found[0])}: {said}; mend or uninstall that package") from error


@cache
def modules_of(package: str) -> tuple[str, ...]:
    """Names of the modules of a package, sorted."""
    return tuple(sorted(module.name for module in pkgutil.iter_modules(importlib.import_module(package).__path__)))


def classes_in(homes: Iterable[str]) -> dict[str, str]:
    """Module of each class that imported modules define, by its name."""
    classes = [(home, value) for home in homes for value in vars(sys.modules[home]).values() if isclass(value)]
    return {value.__name__: home for home, value in classes if value.__module__ == home}


def _origin(entry: EntryPoint) -> str:
    """The package that an entry point belongs to."""
    return f"{entry.dist.name} {entry.dist.version}" if entry.dist else entry.value
