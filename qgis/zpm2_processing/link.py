"""`zpm2 link`: which polygon of one layer is which of another."""

from __future__ import annotations

from typing import ClassVar

from qgis.core import (
    QgsProcessing,
    QgsProcessingContext,
    QgsProcessingFeedback,
    QgsProcessingParameterDefinition,
    QgsProcessingParameterVectorLayer,
)

from .algorithm import Parameters, Zpm2Algorithm


class Link(Zpm2Algorithm):
    """Two layers to the left one with its partners."""

    NAME, TITLE = "link", "Link two layers"
    HELP = (
        "Says which polygon of one layer is which of another, by shape and neighbourhood only, without any "
        "photographs: roof prints of two surveys, parcels of two years. The layers may be shifted and turned against "
        "each other.\n\n"
        "The result is the left layer with the partner of each polygon (zpm2_partner, and its confidence), or the "
        "reason why it has none (zpm2_unmatched), and an arrow from each polygon to its partner."
    )
    LAYERS: ClassVar = {
        "REGIONS": "The left layer with its partners",
        "SHIFTS": "Arrows to the partners",
    }

    def inputs(self) -> list[QgsProcessingParameterDefinition]:
        polygons = [QgsProcessing.TypeVectorPolygon]
        return [
            QgsProcessingParameterVectorLayer("LEFT_LAYER", "Left layer", polygons),
            QgsProcessingParameterVectorLayer("RIGHT_LAYER", "Right layer", polygons),
        ]

    def command_words(
        self, parameters: Parameters, context: QgsProcessingContext, feedback: QgsProcessingFeedback
    ) -> list[str]:
        layers = ("LEFT_LAYER", "RIGHT_LAYER")
        return ["link", *(self.layer(parameters, name, context, feedback) for name in layers)]
