"""`zpm2 match`: the regions that two photographs have in common."""

from __future__ import annotations

from typing import ClassVar

from qgis.core import (
    QgsProcessing,
    QgsProcessingContext,
    QgsProcessingFeedback,
    QgsProcessingParameterBoolean,
    QgsProcessingParameterDefinition,
    QgsProcessingParameterEnum,
    QgsProcessingParameterNumber,
    QgsProcessingParameterRasterLayer,
    QgsProcessingParameterVectorLayer,
)

from .algorithm import PRESET, Parameters, Zpm2Algorithm, choice

REGIONS = {"LEFT_REGIONS": "--left-regions", "RIGHT_REGIONS": "--right-regions"}
CHOICES = {"QUALITY": ("fast", "balanced", "full"), "DETAIL": ("off", "auto", "high")}


class Match(Zpm2Algorithm):
    """Two rasters to two layers of polygons, which name each other."""

    NAME, TITLE = "match", "Match two rasters"
    HELP = (
        "Finds regions (fields, roofs, ponds) in two photographs of the same ground, and which of them show the same "
        "thing. Nothing is trained, and the photographs may differ in date, sensor, scale and direction.\n\n"
        "The result are the polygons of both: matched ones coloured by their confidence, with a number that both "
        "photographs share, and those without a partner coloured by the reason: a report of changes. The report page "
        "(report.html) and all files of zpm2 match are in the folder of the result.\n\n"
        "Give both layers of regions to match your own polygons instead of those that zpm2 finds."
    )
    LAYERS: ClassVar = {"LEFT": "Polygons of the left raster", "RIGHT": "Polygons of the right raster"}

    def inputs(self) -> list[QgsProcessingParameterDefinition]:
        polygons = [QgsProcessing.TypeVectorPolygon]
        small = QgsProcessingParameterNumber(
            "MIN_AREA_M2",
            "Leave out polygons with less ground than (m²)",
            QgsProcessingParameterNumber.Double,
            optional=True,
            minValue=0.0,
        )
        return [
            QgsProcessingParameterRasterLayer("LEFT_RASTER", "Left raster (the first date)"),
            QgsProcessingParameterRasterLayer("RIGHT_RASTER", "Right raster (the second date)"),
            _choice("QUALITY", "How densely to look for regions"),
            _choice("DETAIL", "Look again, closer, for smaller regions"),
            small,
            QgsProcessingParameterBoolean("NON_OVERLAPPING", "Matched polygons share no pixel", False),
            QgsProcessingParameterVectorLayer("LEFT_REGIONS", "Your regions of the left raster", polygons, "", True),
            QgsProcessingParameterVectorLayer("RIGHT_REGIONS", "Your regions of the right raster", polygons, "", True),
        ]

    def command_words(
        self, parameters: Parameters, context: QgsProcessingContext, feedback: QgsProcessingFeedback
    ) -> list[str]:
        words = ["match", *(self.raster(parameters, name, context) for name in ("LEFT_RASTER", "RIGHT_RASTER"))]
        words += ["--format", "gpkg"]  # also where nothing places the photographs
        for name in CHOICES:
            words += choice(f"--{name.lower()}", self.parameterAsEnumString(parameters, name, context))
        if parameters.get("MIN_AREA_M2") is not None:
            words += ["--min-area-m2", str(self.parameterAsDouble(parameters, "MIN_AREA_M2", context))]
        if self.parameterAsBool(parameters, "NON_OVERLAPPING", context):
            words.append("--non-overlapping")
        for name, option in REGIONS.items():
            if parameters.get(name):
                words += [option, self.layer(parameters, name, context, feedback)]
        return words


def _choice(name: str, title: str) -> QgsProcessingParameterEnum:
    return QgsProcessingParameterEnum(name, title, [PRESET, *CHOICES[name]], False, PRESET, False, True)
