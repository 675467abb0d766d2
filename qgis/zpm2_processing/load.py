"""Layers of a result that is already there."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

from qgis.core import (
    QgsProcessingContext,
    QgsProcessingException,
    QgsProcessingFeedback,
    QgsProcessingParameterDefinition,
    QgsProcessingParameterFile,
)

from .algorithm import OUTPUT, Parameters, Zpm2Algorithm
from .results import layers_of


class Load(Zpm2Algorithm):
    """A folder that a command wrote to layers with styles."""

    NAME, TITLE = "load", "Load a result"
    HELP = (
        "Loads the layers of a folder that zpm2 match, carry or link wrote, on this machine or another one, with their "
        "styles: matched polygons by confidence, others by the reason, shifts as arrows."
    )
    LAYERS: ClassVar = {
        "LEFT": "Polygons of the left raster",
        "RIGHT": "Polygons of the right raster",
        "REGIONS": "Carried or linked layer",
        "SHIFTS": "Arrows",
    }

    def initAlgorithm(self, config: Parameters | None = None) -> None:
        folder = QgsProcessingParameterFile("FOLDER", "Folder of the result", QgsProcessingParameterFile.Folder)
        self.addParameter(folder)
        self.add_layers()

    def inputs(self) -> list[QgsProcessingParameterDefinition]:
        return []

    def processAlgorithm(
        self, parameters: Parameters, context: QgsProcessingContext, feedback: QgsProcessingFeedback
    ) -> dict[str, object]:
        folder = Path(self.parameterAsFile(parameters, "FOLDER", context))
        if not layers_of(folder):
            raise QgsProcessingException(
                f"{folder} has no layers of zpm2: give the folder that zpm2 match (with --format gpkg where the "
                "photographs have no place), carry or link wrote"
            )
        return {OUTPUT: str(folder), **self.load(folder, parameters, context, feedback)}
