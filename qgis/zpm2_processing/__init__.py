"""A QGIS plug-in: zpm2's commands as Processing algorithms. `command` and `results` need no QGIS."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from qgis.gui import QgisInterface

    from .provider import Plugin


def classFactory(iface: QgisInterface | None) -> Plugin:
    """What QGIS calls to load a plug-in. Without a window (qgis_process), `iface` is None."""
    from .provider import Plugin

    return Plugin()
