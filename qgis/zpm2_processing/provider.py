"""The plug-in and its Processing provider, with one setting: the path of the zpm2 command."""

from __future__ import annotations

from pathlib import Path

from processing.core.ProcessingConfig import ProcessingConfig, Setting
from qgis.core import QgsApplication, QgsProcessingProvider
from qgis.PyQt.QtGui import QIcon

from .algorithm import COMMAND
from .carry import Carry
from .link import Link
from .load import Load
from .match import Match

ICON = Path(__file__).parent / "icon.svg"


class Plugin:
    """Adds the provider to Processing while the plug-in is on."""

    def __init__(self) -> None:
        self.provider: Provider | None = None

    def initProcessing(self) -> None:
        """Called alone by qgis_process."""
        self.provider = Provider()
        QgsApplication.processingRegistry().addProvider(self.provider)

    def initGui(self) -> None:
        """Called by the desktop."""
        self.initProcessing()

    def unload(self) -> None:
        """Called by the desktop when the plug-in is switched off."""
        QgsApplication.processingRegistry().removeProvider(self.provider)


class Provider(QgsProcessingProvider):
    """The group zpm2 of the Processing toolbox."""

    def load(self) -> bool:
        """Also adds the setting."""
        ProcessingConfig.settingIcons[self.name()] = self.icon()
        hint = "Path of the zpm2 command (empty: the one on PATH)"
        ProcessingConfig.addSetting(Setting(self.name(), COMMAND, hint, "", valuetype=Setting.FILE))
        ProcessingConfig.readSettings()
        self.refreshAlgorithms()
        return True

    def unload(self) -> None:
        ProcessingConfig.removeSetting(COMMAND)

    def loadAlgorithms(self) -> None:
        for algorithm in (Match, Carry, Link, Load):
            self.addAlgorithm(algorithm())

    def id(self) -> str:
        return "zpm2"

    def name(self) -> str:
        return "zpm2"

    def icon(self) -> QIcon:
        return QIcon(str(ICON))
