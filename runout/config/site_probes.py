"""Reads the probes of a site as site.yaml states them."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from runout.config.document import Document, read_document
from runout.config.fetch import locate
from runout.config.probes import ProbeSettings
from runout.errors import ConfigError, Problem

if TYPE_CHECKING:
    from runout.model.probes import Probe, Probes
    from runout.model.terrain import Terrain


@dataclass(frozen=True)
class SiteProbes:
    """The probes of a site.

    Attributes
    ----------
    settings : ProbeSettings or None
        What site.yaml states.
    file : Path
        The site.yaml; other paths are relative to its folder.
    """

    settings: ProbeSettings | None
    file: Path

    def read(self, terrain: "Terrain") -> "Probes | None":
        """The probes on a terrain; None if site.yaml states none.

        Raises
        ------
        ConfigError
            With all problems of points and lines, each with its line of site.yaml.
        """
        from runout.io.probe_layers import read_probes

        stated = self.settings
        if stated is None:
            return None
        try:
            return read_probes(
                terrain,
                self._path(stated.points),
                self._path(stated.cross_sections),
                points_layer=stated.points_layer,
                cross_sections_layer=stated.cross_sections_layer,
                interval=stated.interval,
                stated=self._listed(),
            )
        except ConfigError as error:
            raise ConfigError([self._placed(problem) for problem in error.problems]) from None

    def _listed(self) -> "tuple[Probe, ...]":
        """Points that site.yaml itself lists."""
        from runout.model.probes import Probe

        points = self.settings.points if self.settings else None
        places = enumerate([] if points is None or isinstance(points, str) else points)
        return tuple(Probe(p.name, p.x, p.y, f"probes.points[{i}]") for i, p in places)

    def _placed(self, problem: Problem) -> Problem:
        """A problem with the line and the key of site.yaml that it is about, if it is about that file."""
        assert self.settings is not None
        document = read_document(self.file) if self.file.is_file() else Document(self.file.name)
        points = self.settings.points
        if isinstance(points, list):
            for i in range(len(points)):
                if problem.file == f"probes.points[{i}]":
                    place = ("probes", "points", i, *([problem.key] if problem.key else []))
                    return document.problem(place, problem.message, problem.fix)
        for key in ("points", "cross_sections"):
            named = getattr(self.settings, key)
            path = self._path(named)
            in_file = document.value(("probes", key)) == named  # else the command line names it
            if path is not None and in_file and problem.file.startswith(str(path)):
                said = ": ".join(part for part in (problem.file, problem.key, problem.message) if part)
                return document.problem(("probes", key), said, problem.fix)
        return problem

    def _path(self, stated: object) -> Path | None:
        return Path(locate(stated, self.file.parent)) if isinstance(stated, str) else None


def probe_settings(
    folder: Path,
    points: Path | None,
    cross_sections: Path | None,
    *,
    points_layer: str | None = None,
    cross_sections_layer: str | None = None,
    interval: float | None = None,
) -> ProbeSettings:
    """Settings of probes from files of the command line; paths inside the site folder are named relative to it.

    Raises
    ------
    ConfigError
        If a file does not exist, a layer has no file, or the interval is not above 0.
    """
    from runout.config.read import nearest_file

    problems = []
    for path in (points, cross_sections):
        if path is not None and not path.exists():
            near = nearest_file(path)
            fix = f"did you mean {near}?" if near else "check the path"
            problems.append(Problem(str(path), None, "", "there is no such file", fix))
    for option, layer, path in (("points", points_layer, points), ("cross-sections", cross_sections_layer, cross_sections)):
        if layer is not None and path is None:
            fix = f"name the file with --{option}, or leave the layer out"
            problems.append(Problem("probe", None, f"--{option}-layer", f"{layer[:80]!r} without a file", fix))
    if interval is not None and not interval > 0:
        problems.append(Problem("probe", None, "--interval", f"{interval:g} s; it must be above 0", "leave it out for the default"))
    if problems:
        raise ConfigError(problems)
    named = {"points": points, "cross_sections": cross_sections}
    given = {key: _named(path, folder) for key, path in named.items() if path is not None}
    layers = {"points_layer": points_layer, "cross_sections_layer": cross_sections_layer}
    return ProbeSettings(**given, **layers, interval=interval)  # type: ignore[arg-type]


def _named(path: Path, folder: Path) -> str:
    absolute, root = Path(os.path.abspath(path)), Path(os.path.abspath(folder))
    return absolute.relative_to(root).as_posix() if absolute.is_relative_to(root) else str(absolute)
