"""Calls the algorithms of the plugin in QGIS without a display; prints what each gives as one line of JSON.

The Python of QGIS runs this: ``python3 headless.py ZIP FOLDER COMMAND``; FOLDER gets the profile of QGIS and the sites.
"""

import json
import os
import shutil
import sys
import threading
import time
import zipfile
from pathlib import Path

ARCHIVE, FOLDER, COMMAND = Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3]
PLUGINS = FOLDER / "profile" / "python" / "plugins"
os.environ |= {"QT_QPA_PLATFORM": "offscreen", "QGIS_CUSTOM_CONFIG_PATH": str(FOLDER / "profile"), "XDG_CONFIG_HOME": str(FOLDER)}
# what QGIS of Windows and macOS sets; the command must not see it
os.environ |= {"PROJ_DATA": "/nowhere", "PROJ_LIB": "/nowhere", "GDAL_DATA": "/nowhere", "PYTHONHOME": "/nowhere"}
del os.environ["PROJ_DATA"], os.environ["PROJ_LIB"], os.environ["GDAL_DATA"]  # before QGIS itself starts
for place in ("/usr/share/qgis/python/plugins", "/usr/share/qgis/python", str(PLUGINS)):
    sys.path.insert(0, place)
with zipfile.ZipFile(ARCHIVE) as archive:
    archive.extractall(PLUGINS)

import numpy as np  # noqa: E402
from osgeo import gdal, osr  # noqa: E402
from qgis import core, utils  # noqa: E402

WEST, NORTH, CELL, ROWS, COLUMNS = 500_000.0, 5_000_000.0, 10.0, 24, 50
SYSTEM = "EPSG:32632"
application = core.QgsApplication([], False)
application.initQgis()
os.environ |= {"PROJ_DATA": "/nowhere", "GDAL_DATA": "/nowhere"}

import processing  # noqa: E402
from processing.core.Processing import Processing  # noqa: E402
from processing.core.ProcessingConfig import ProcessingConfig  # noqa: E402

Processing.initialize()


class Feedback(core.QgsProcessingFeedback):
    """Keeps the messages and the progress."""

    def __init__(self):
        super().__init__(False)
        self.lines, self.shares = [], []
        self.progressChanged.connect(self.shares.append)

    def pushInfo(self, text):
        self.lines.append(text)

    pushWarning = pushCommandInfo = pushInfo

    def reportError(self, text, fatalError=False):
        self.lines.append(f"ERROR {text}")


def call(name, feedback=None, **parameters):
    """What an algorithm gives: outputs, messages, progress; or the text of its error."""
    feedback = feedback or Feedback()
    context = core.QgsProcessingContext()
    context.setProject(core.QgsProject.instance())
    try:
        outputs = processing.run(f"runout:{name}", parameters, feedback=feedback, context=context)
        return {"outputs": outputs, "lines": feedback.lines, "shares": feedback.shares}
    except core.QgsProcessingException as error:
        return {"error": str(error), "lines": feedback.lines}


def layer(kind, text, **attributes):
    """A layer in memory, whose feature is not saved yet."""
    made = core.QgsVectorLayer(f"{kind}?crs={SYSTEM}&field=fid:integer&field=depth:double", f"my {kind}", "memory")
    made.startEditing()
    feature = core.QgsFeature(made.fields())
    feature.setGeometry(core.QgsGeometry.fromWkt(text))
    for name, value in attributes.items():
        feature[name] = value
    made.addFeature(feature)
    return made


def dem():
    """A slope of 30 degrees that runs out into a plain, as a GeoTIFF."""
    easting = (np.arange(COLUMNS) + 0.5) * CELL
    values = np.broadcast_to(np.maximum(0.0, (250.0 - easting) * np.tan(np.radians(30.0))), (ROWS, COLUMNS))
    file = gdal.GetDriverByName("GTiff").Create(str(FOLDER / "ramp.tif"), COLUMNS, ROWS, 1, gdal.GDT_Float32)
    file.SetGeoTransform((WEST, CELL, 0, NORTH, 0, -CELL))
    system = osr.SpatialReference()
    system.ImportFromEPSG(32632)
    file.SetProjection(system.ExportToWkt())
    file.GetRasterBand(1).WriteArray(values.astype("float32"))
    file = None
    return core.QgsRasterLayer(str(FOLDER / "ramp.tif"), "ramp")


def box(west, south, east, north):
    """A rectangle as text, from the north-western corner of the raster [m]."""
    return core.QgsGeometry.fromRect(core.QgsRectangle(WEST + west, NORTH + south, WEST + east, NORTH + north)).asWkt()


def edited(site, **changes):
    """Write other values of keys to site.yaml, and settings that make a short run."""
    path = Path(site) / "site.yaml"
    lines = path.read_text(encoding="utf-8").split("\n")
    for key, value in changes.items():
        lines = [f"{line[: len(line) - len(line.lstrip())]}{key}: {value}" if line.strip().startswith(f"{key}: ") else line
                 for line in lines]  # fmt: skip
    path.write_text("\n".join(lines), encoding="utf-8")


def observe(site):
    """State the outline of the release as the mapped deposit of an event, and members enough to be calibrated."""
    shutil.copy(Path(site) / "inputs" / "release.gpkg", Path(site) / "inputs" / "mapped.gpkg")
    edited(site, members="16", cell_size="12.5")
    path = Path(site) / "site.yaml"
    lines = path.read_text(encoding="utf-8").split("\n")
    lines = [line for line in lines if not line.strip().startswith(("basal_xi: {", "density: {"))]  # one parameter is left
    path.write_text("\n".join([*lines, "observations: {outline: {polygons: inputs/mapped.gpkg}}", ""]), encoding="utf-8")


def cancelled(site):
    """What a run gives that is cancelled at its first member, how long that took, and the processes that are left."""
    feedback = Feedback()

    def watch():
        while not any(line.startswith("member") for line in feedback.lines):
            time.sleep(0.05)
        watch.time = time.monotonic()
        feedback.cancel()

    threading.Thread(target=watch, daemon=True).start()
    answer = call("run", feedback, SITE=str(site), WORKERS=1, OPEN=False)
    waited = time.monotonic() - getattr(watch, "time", 0.0)
    left = [p for p in Path("/proc").glob("[0-9]*") if str(site).encode() in _command_line(p)]
    return {**answer, "waited": waited, "left": [p.name for p in left]}


def _command_line(process):
    try:
        return (process / "cmdline").read_bytes() if int(process.name) != os.getpid() else b""
    except OSError:
        return b""


def say(name, answer):
    """Print one answer."""
    print("ANSWER", json.dumps({"name": name, **answer}, default=str), flush=True)


utils.plugin_paths = [str(PLUGINS)]
utils.updateAvailablePlugins()
say("load", {"loaded": utils.loadPlugin("runout_qgis"), "started": utils.startProcessingPlugin("runout_qgis")})
provider = application.processingRegistry().providerById("runout")
say("provider", {"algorithms": sorted(one.name() for one in provider.algorithms()),
                 "help": [one.shortHelpString() for one in provider.algorithms()]})  # fmt: skip
from runout_qgis import command  # noqa: E402

lines = (
    "terrain: done in 0.9 s",
    "member 4 (5c2e6e) done in 5.3 s, 1 of 2",
    "stage 3 of 5, ensemble, 4 of 16 members, 25 %, 60 s left",
    "8 of 8 members to simulate, 2 at a time",
    "release: 22% of 6.9e+06 m3",
    "terrain",
)
say("progress", {"shares": [command.progress(line) for line in lines]})
elevation, release = dem(), layer("Polygon", box(50, -150, 110, -90), depth=8.0)
site = FOLDER / "ramp site"
stated = {"DEM": elevation, "RELEASE": release, "PROCESS": "debris_flow", "SITE": str(site)}
home = os.environ["HOME"]
os.environ["HOME"] = str(FOLDER)  # no command of the user is there
say("absent", call("new", **stated, FIELD="depth"))
os.environ["HOME"] = home
ProcessingConfig.setSettingValue("RUNOUT_COMMAND", str(PLUGINS))
say("wrong", call("new", **stated, FIELD="depth"))
ProcessingConfig.setSettingValue("RUNOUT_COMMAND", COMMAND)
say("twice", call("new", **stated, FIELD="depth", THICKNESS=3.0))
say("new", call("new", **stated, FIELD="depth"))
edited(site, members="2", end_time="soon")
say("bad", call("check", SITE=str(site)))
edited(site, end_time="5")
say("check", call("check", SITE=str(site)))
say("early", call("open_results", SITE=str(site)))
say("cancel", cancelled(site))
say("run", call("run", SITE=str(site), WORKERS=1, OPEN=True))
tree = core.QgsProject.instance().layerTreeRoot()
drawn = {one.name(): type(one.renderer()).__name__ for one in core.QgsProject.instance().mapLayers().values()}
say("layers", {"groups": [one.name() for one in tree.children()], "drawn": drawn})
middle = NORTH - 120
say(
    "profile", call("profile", SITE=str(site), LINE=layer("LineString", f"LINESTRING({WEST + 60} {middle}, {WEST + 400} {middle})"))
)
say("probe", call("probe", SITE=str(site), POINTS=layer("Point", f"POINT({WEST + 200} {middle})"), MEMBER=1))
say("compare", call("compare", SITE=str(site), LAYER=layer("Polygon", box(50, -170, 300, -70)), FOLDER=str(FOLDER / "scores")))
say("calibrate", call("calibrate", SITE=str(site)))
recorder = FOLDER / "recorder.sh"
recorder.write_text('#!/bin/sh\nfor word in "$@"; do echo "word $word"; done\n')
recorder.chmod(0o755)
ProcessingConfig.setSettingValue("RUNOUT_COMMAND", str(recorder))
values = {"VALUES": "basal_mu=0.05:0.2:0.05 bulking=1,2", "CELL_SIZE": 12.5, "FOLDER": str(FOLDER / "if")}
say("what_if", call("what_if", SITE=str(site), **values, OPTIONS="--one-at-a-time"))
ProcessingConfig.setSettingValue("RUNOUT_COMMAND", COMMAND)
tried = {"VALUES": "basal_mu=0.1,0.2", "CELL_SIZE": 12.5, "FOLDER": str(FOLDER / "swept")}
say("swept", call("what_if", SITE=str(site), **tried))
core.QgsProject.instance().clear()
say("open", call("open_results", SITE=str(site)))
observe(site)
say("observed", call("run", SITE=str(site), OPEN=False))
say("calibrated", call("calibrate", SITE=str(site), ERROR="outline.area=20%", ROUNDS=1, POINTS=2))
sys.stdout.flush()
os._exit(0)  # QGIS may crash when the interpreter frees its objects
