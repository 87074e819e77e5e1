"""The plugin, and the provider of its algorithms for the processing toolbox."""

from __future__ import annotations

from pathlib import Path

from processing.core.ProcessingConfig import ProcessingConfig, Setting
from qgis.core import QgsApplication, QgsProcessingProvider
from qgis.PyQt.QtGui import QIcon

from .algorithms import ALGORITHMS
from .command import SETTING

ICON = Path(__file__).with_name("icon.svg")
MEANING = "Command runout, Python of its environment, or folder of that (default: the one on the PATH)"


class Plugin:
    """What QGIS loads: it adds the provider and takes it away."""

    provider: QgsProcessingProvider

    def initProcessing(self) -> None:  # qgis_process calls this alone
        self.provider = Provider()
        QgsApplication.processingRegistry().addProvider(self.provider)

    initGui = initProcessing

    def unload(self) -> None:
        QgsApplication.processingRegistry().removeProvider(self.provider)


class Provider(QgsProcessingProvider):
    """Algorithms of runout."""

    def id(self) -> str:
        return "runout"

    def name(self) -> str:
        return "runout"

    def icon(self) -> QIcon:
        return QIcon(str(ICON))

    def load(self) -> bool:
        ProcessingConfig.settingIcons["runout"] = self.icon()
        ProcessingConfig.addSetting(Setting("runout", SETTING, MEANING, "", valuetype=Setting.FILE))
        ProcessingConfig.readSettings()
        self.refreshAlgorithms()
        return True

    def unload(self) -> None:
        ProcessingConfig.removeSetting(SETTING)

    def loadAlgorithms(self) -> None:
        for algorithm in ALGORITHMS:
            self.addAlgorithm(algorithm())
