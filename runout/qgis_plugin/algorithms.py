"""The algorithms: their parameters in the toolbox, and the words of the command that these become."""

from __future__ import annotations

import shlex
import tempfile
from functools import partial
from pathlib import Path

from qgis import core

from .command import run
from .layers import add_results, exported, file_name, raster_file

NONE = "none"
PROCESSES = ("rock_avalanche", "ice_rock_avalanche", "debris_flow", "hillslope_debris_flow", "mud_flow", "snow_avalanche")
POLYGONS, LINES, POINTS = (
    core.QgsProcessing.TypeVectorPolygon,
    core.QgsProcessing.TypeVectorLine,
    core.QgsProcessing.TypeVectorPoint,
)
ENUM = partial(core.QgsProcessingParameterEnum, usesStaticStrings=True)
FIELD = partial(core.QgsProcessingParameterField, type=core.QgsProcessingParameterField.Numeric, optional=True)
FOLDER = partial(core.QgsProcessingParameterFile, behavior=core.QgsProcessingParameterFile.Folder)
LAYER = core.QgsProcessingParameterFeatureSource
NUMBER = partial(core.QgsProcessingParameterNumber, type=core.QgsProcessingParameterNumber.Double, defaultValue=None, optional=True)
TEXT = partial(core.QgsProcessingParameterString, optional=True)
WHOLE = partial(NUMBER, type=core.QgsProcessingParameterNumber.Integer)
SITE = partial(FOLDER, "SITE", "Folder of the site")
OPEN = partial(core.QgsProcessingParameterBoolean, "OPEN", "Open the results", True)


class Algorithm(core.QgsProcessingAlgorithm):
    """A command of runout as an algorithm; the docstring is its help.

    ``inputs`` make the parameters. ``passed`` are the options of the command by the names of parameters, in the order of the call;
    an empty option is an argument by place. Exactly one parameter of ``one_of`` has a value. ``files`` is the folder, below that
    of the site, to which layers are written; one that vanishes if it is empty. ``writes`` is the folder of the results.
    """

    command, title = "", ""
    inputs: tuple = (SITE,)
    passed: dict = {}
    one_of: tuple = ()
    files, writes, page = "", "results", ""
    opened: Path | None = None

    def createInstance(self):
        return type(self)()

    def name(self):
        return self.command.replace("-", "_")

    def displayName(self):
        return self.title

    def shortHelpString(self):
        return " ".join(self.__doc__.split())

    def initAlgorithm(self, configuration=None):
        for make in self.inputs:
            self.addParameter(make())
        options = TEXT("OPTIONS", f"Further options, see: runout {self.command} --help")
        options.setFlags(options.flags() | core.QgsProcessingParameterDefinition.FlagAdvanced)
        self.addParameter(options)
        self.addOutput(core.QgsProcessingOutputFolder("RESULTS", "Folder of the results"))
        self.addOutput(core.QgsProcessingOutputString("TEXT", "Messages"))
        if self.page:
            self.addOutput(core.QgsProcessingOutputHtml("PAGE", "Page"))

    def checkParameterValues(self, parameters, context):
        if self.one_of and sum(parameters.get(name) not in (None, "") for name in self.one_of) != 1:
            titles = [self.parameterDefinition(name).description() for name in self.one_of]
            return False, f"Give one of these: {'; '.join(titles)}"
        return super().checkParameterValues(parameters, context)

    def processAlgorithm(self, parameters, context, feedback):
        site = Path(self.parameterAsString(parameters, "SITE", context))
        with tempfile.TemporaryDirectory() as temporary:
            folder = site / self.files if self.files else Path(temporary)
            words = [self.command, site]
            for name, option in {**self.passed, "OPTIONS": ""}.items():
                values = self.values(parameters, name, context, folder)
                words += [option, *values] if values and option else values
            lines = run(words, feedback)
        results = Path(words[words.index("--out") + 1]) if "--out" in words else site / self.writes
        if self.parameterDefinition("OPEN") and self.parameterAsBool(parameters, "OPEN", context):
            self.opened = results
        page = {"PAGE": str(results / self.page)} if self.page else {}
        return {"SITE": str(site), "RESULTS": str(results), "TEXT": "\n".join(lines), **page}

    def values(self, parameters, name, context, folder):
        """Words of the call for the value of a parameter; none without one."""
        kind, value = self.parameterDefinition(name).type(), parameters.get(name)
        layer = self.parameterAsLayer(parameters, name, context) if kind in ("layer", "raster") and value else None
        if layer is not None and not hasattr(layer, "getFeatures"):
            return [raster_file(layer, folder, context)]
        if kind in ("layer", "source"):
            return [self.written(parameters, name, context, folder)] if value not in (None, "") else []
        if kind == "enum":
            return [text] if (text := self.parameterAsEnumString(parameters, name, context)) != NONE else []
        if kind == "crs":
            return [text] if (text := self.parameterAsCrs(parameters, name, context).authid()) else []
        text = self.parameterAsString(parameters, name, context)
        return shlex.split(text) if kind == "string" else [text] if text else []

    def written(self, parameters, name, context, folder):
        """The features of a layer as a GeoPackage with the name of the layer."""
        source = self.parameterAsSource(parameters, name, context)
        if source is None:
            raise core.QgsProcessingException(self.invalidSourceError(parameters, name))
        return exported(source, folder / f"{file_name(source.sourceName())}.gpkg", context)

    def postProcessAlgorithm(self, context, feedback):
        """Add the layers; QGIS calls this in the thread of the project."""
        if self.opened is not None:
            site = self.opened.parent.name if self.opened.name == "results" else self.opened.name
            names = add_results(self.opened, f"runout {site}", context.project() or core.QgsProject.instance())
            feedback.pushInfo(f"{len(names)} layers of {self.opened} are open")
        return {}


class New(Algorithm):
    """Makes the folder of a site from an elevation layer and polygons of the release, with the published laws, values and ranges
    of a process and their sources. The site gets copies of the layers as QGIS shows them, with edits that are not saved. Open
    site.yaml in a text editor to change settings.
    """

    command, title, writes, one_of = "new", "1 New site", ".", ("FIELD", "THICKNESS")
    inputs = (
        partial(core.QgsProcessingParameterRasterLayer, "DEM", "Elevation"),
        partial(LAYER, "RELEASE", "Release polygons", [POLYGONS]),
        partial(FIELD, "FIELD", "Field with the thickness [m]", parentLayerParameterName="RELEASE"),
        partial(NUMBER, "THICKNESS", "Thickness for all polygons [m]", minValue=1e-5),
        partial(ENUM, "PROCESS", "Process with published values", (NONE, *PROCESSES), defaultValue=NONE),
        partial(core.QgsProcessingParameterCrs, "CRS", "Coordinate system of an elevation file that states none", optional=True),
        partial(FOLDER, "SITE", "Folder of the new site; a folder that is there must be empty"),
    )
    passed = {"DEM": "--dem", "RELEASE": "--release", "FIELD": "--thickness", "THICKNESS": "--thickness"}
    passed |= {"PROCESS": "--process", "CRS": "--crs"}


class Check(Algorithm):
    """Lists every problem of a site and forecasts time, memory and numerical error of its run. A problem fails the algorithm."""

    command, title, writes = "check", "2 Check site", "."


class Run(Algorithm):
    """Runs what is not up to date: terrain, release, members of the ensemble, maps, report. Progress is that of the members. Cancel
    ends it at once; finished members are kept, and the next run continues.
    """

    command, title = "run", "3 Run site"
    inputs = (
        SITE,
        partial(WHOLE, "WORKERS", "Members at once (default: one for each core)", minValue=1),
        partial(TEXT, "BUDGET", "Time that cells and members must fit into (30min)"),
        OPEN,
    )
    passed = {"WORKERS": "--workers", "BUDGET": "--budget"}


class Open(Algorithm):
    """Adds the maps and outlines of a site with their styles as one group of layers."""

    command, title, inputs = "open-results", "4 Open results", (SITE,)

    def flags(self):
        return super().flags() | core.QgsProcessingAlgorithm.FlagNoThreading  # it changes the project

    def processAlgorithm(self, parameters, context, feedback):
        site = Path(self.parameterAsString(parameters, "SITE", context))
        self.opened = site / "results" if (site / "results").is_dir() else site
        if not (self.opened / "hazard.nc").is_file():
            raise core.QgsProcessingException(f"{site}: has no results yet; run the site first")
        return {"RESULTS": str(self.opened)}


class WhatIf(Algorithm):
    """Runs a site for values of parameters, on coarse cells by default: a page with a map, a slider and what they change."""

    command, title, writes, page = "what-if", "What if: values of parameters", "", "what_if.html"
    inputs = (
        SITE,
        partial(TEXT, "VALUES", "Values, such as basal_mu=0.05:0.2:0.05 or release_volume_factor=0.5,1,2", optional=False),
        partial(TEXT, "BUDGET", "Time of all runs", "5min"),
        partial(NUMBER, "CELL_SIZE", "Grid spacing [m] (default: cells that fit into the time)", minValue=1e-3),
        partial(FOLDER, "FOLDER", "Folder for page and runs, new or of an earlier call"),
    )
    passed = {"VALUES": "", "BUDGET": "--budget", "CELL_SIZE": "--cell-size", "FOLDER": "--out"}


class Compare(Algorithm):
    """Scores the results of a site against those of another one, a raster, or a mapped outline: a page and difference maps."""

    command, title, writes, one_of, page = "compare", "Compare results", "", ("OTHER", "LAYER"), "comparison.html"
    inputs = (
        SITE,
        partial(FOLDER, "OTHER", "Against this site or these results", optional=True),
        partial(core.QgsProcessingParameterMapLayer, "LAYER", "Against this raster, outline or these points", optional=True),
        OPEN,
        partial(core.QgsProcessingParameterFolderDestination, "FOLDER", "Page and maps"),
    )
    passed = {"OTHER": "", "LAYER": "", "FOLDER": "--out"}


class Profile(Algorithm):
    """Writes ground, peak thickness and speed, arrival and deposit along the lines of a layer: tables and figures."""

    command, title, files, writes = "profile", "Profiles along lines", "inputs/from_qgis", "results/profiles"
    inputs = (
        SITE,
        partial(LAYER, "LINE", "Lines: a thalweg, or across the flow", [LINES]),
        partial(WHOLE, "MEMBER", "Member (default: percentiles of all)", minValue=0),
    )
    passed = {"LINE": "--line", "MEMBER": "--member"}


class Probe(Algorithm):
    """Writes time series of thickness, speed and discharge at points and through lines across the flow. Without layers, the probes
    of site.yaml count. A member that has no series at these places runs again.
    """

    command, title, files, writes = "probe", "Time series at points and sections", "inputs/from_qgis", "results/probes"
    inputs = (
        SITE,
        partial(LAYER, "POINTS", "Points", [POINTS], optional=True),
        partial(LAYER, "LINES", "Lines across the flow", [LINES], optional=True),
        partial(WHOLE, "MEMBER", "Member (default: 0 with layers, else all)", minValue=0),
    )
    passed = {"POINTS": "--points", "LINES": "--cross-sections", "MEMBER": "--member"}


class Calibrate(Algorithm):
    """Finds the values of the sampled parameters that agree with the observations of site.yaml, with their uncertainty, and writes
    them as a table for an ensemble. It runs further members, and continues where it was ended.
    """

    command, title, writes = "calibrate", "Calibrate with observations", "results/calibration"
    inputs = (
        SITE,
        partial(TEXT, "ERROR", "Standard errors, such as outline.area=5% gauges.speed=0.5"),
        partial(WHOLE, "ROUNDS", "Rounds of further runs", defaultValue=2, minValue=0, maxValue=8),
        partial(WHOLE, "POINTS", "Runs of each round", defaultValue=16, minValue=1, maxValue=1024),
    )
    passed = {"ERROR": "--error", "ROUNDS": "--rounds", "POINTS": "--points"}


ALGORITHMS = (New, Check, Run, Open, WhatIf, Compare, Profile, Probe, Calibrate)
