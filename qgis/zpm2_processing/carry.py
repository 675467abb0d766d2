"""`zpm2 carry`: the polygons of a layer, found in another photograph."""

from __future__ import annotations

from typing import ClassVar

from qgis.core import (
    QgsProcessing,
    QgsProcessingContext,
    QgsProcessingFeedback,
    QgsProcessingParameterBoolean,
    QgsProcessingParameterDefinition,
    QgsProcessingParameterMultipleLayers,
    QgsProcessingParameterRasterLayer,
    QgsProcessingParameterVectorLayer,
)

from .algorithm import Parameters, Zpm2Algorithm


class Carry(Zpm2Algorithm):
    """A layer of one raster to the same layer of others."""

    NAME, TITLE = "carry", "Carry a layer to other rasters"
    HELP = (
        "Finds each polygon of a layer, drawn on one photograph, in others: footprints in a new orthophoto, fields of "
        "last year, objects that somebody labelled.\n\n"
        "The result is the layer with the same ids and attributes at its new places, and what became of each polygon "
        "(zpm2_status): found, in part, outside, hidden (covered, changed or gone), not found. Arrows show where each "
        "one went."
    )
    LAYERS: ClassVar = {
        "REGIONS": "The layer in the first other raster",
        "SHIFTS": "Arrows to the new places",
    }

    def inputs(self) -> list[QgsProcessingParameterDefinition]:
        polygons = [QgsProcessing.TypeVectorPolygon]
        return [
            QgsProcessingParameterRasterLayer("LEFT_RASTER", "Raster that the layer belongs to"),
            QgsProcessingParameterVectorLayer("LAYER", "Layer of polygons", polygons),
            QgsProcessingParameterMultipleLayers("RIGHT_RASTERS", "Other rasters", QgsProcessing.TypeRaster),
            QgsProcessingParameterBoolean("RIGID", "Keep the form of the outlines, only move them", False),
        ]

    def command_words(
        self, parameters: Parameters, context: QgsProcessingContext, feedback: QgsProcessingFeedback
    ) -> list[str]:
        rights = self.parameterAsLayerList(parameters, "RIGHT_RASTERS", context)
        words = ["carry", self.raster(parameters, "LEFT_RASTER", context)]
        words += [self.raster_file(layer) for layer in rights]
        words += ["--regions", self.layer(parameters, "LAYER", context, feedback)]
        return [*words, "--rigid"] if self.parameterAsBool(parameters, "RIGID", context) else words
