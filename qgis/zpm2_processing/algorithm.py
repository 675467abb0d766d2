"""What the algorithms share: inputs as the command takes them, the run, and results with their styles."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import ClassVar

from processing.core.ProcessingConfig import ProcessingConfig
from qgis.core import (
    QgsMapLayer,
    QgsProcessingAlgorithm,
    QgsProcessingContext,
    QgsProcessingException,
    QgsProcessingFeedback,
    QgsProcessingLayerPostProcessorInterface,
    QgsProcessingOutputVectorLayer,
    QgsProcessingParameterBoolean,
    QgsProcessingParameterDefinition,
    QgsProcessingParameterFolderDestination,
    QgsProcessingParameterString,
    QgsProviderRegistry,
)
from qgis.PyQt.QtGui import QIcon

from . import command
from .results import ResultLayer, layers_of

COMMAND = "ZPM2_COMMAND"  # name of the setting
OUTPUT, LOAD, EXTRA = "OUTPUT", "LOAD_LAYERS", "EXTRA"
PRESET = "preset's"  # the value of a choice that is left to the preset
FORMATS = ["gpkg", "geojson"]  # whose columns keep their names; others are exported as the first one

Parameters = dict[str, object]


class Zpm2Algorithm(QgsProcessingAlgorithm):
    """An algorithm that ends with the layers of a result folder. Subclasses give `command_words`."""

    NAME: ClassVar[str]
    TITLE: ClassVar[str]
    HELP: ClassVar[str]
    LAYERS: ClassVar[dict[str, str]]  # output -> its description

    def initAlgorithm(self, config: Parameters | None = None) -> None:
        """The parameters that all commands have, after those of the subclass (`inputs`)."""
        for parameter in self.inputs():
            self.addParameter(parameter)
        extra = QgsProcessingParameterString(EXTRA, "Further options of the command", "", optional=True)
        extra.setFlags(extra.flags() | QgsProcessingParameterDefinition.FlagAdvanced)
        extra.setHelp("As on the command line, for example: --set points.max_keypoints=4000 --device cpu")
        self.addParameter(extra)
        self.addParameter(QgsProcessingParameterFolderDestination(OUTPUT, "Folder for the result"))
        self.add_layers()

    def add_layers(self) -> None:
        """The choice to load the layers, and the outputs."""
        self.addParameter(QgsProcessingParameterBoolean(LOAD, "Load the layers with their styles", True))
        for output, description in self.LAYERS.items():
            self.addOutput(QgsProcessingOutputVectorLayer(output, description))

    def inputs(self) -> list[QgsProcessingParameterDefinition]:
        """The parameters of this algorithm."""
        raise NotImplementedError

    def command_words(
        self, parameters: Parameters, context: QgsProcessingContext, feedback: QgsProcessingFeedback
    ) -> list[str]:
        """The command and its inputs and options, without the output folder."""
        raise NotImplementedError

    def processAlgorithm(
        self, parameters: Parameters, context: QgsProcessingContext, feedback: QgsProcessingFeedback
    ) -> dict[str, object]:
        folder = Path(self.parameterAsString(parameters, OUTPUT, context))
        words = self.command_words(parameters, context, feedback)
        try:
            words += shlex.split(self.parameterAsString(parameters, EXTRA, context))
            zpm2 = command.find(ProcessingConfig.getSetting(COMMAND) or "")
            command.run([zpm2, *words, "-o", str(folder)], feedback)
        except ValueError as error:
            raise QgsProcessingException(f"Further options of the command: {error}") from error
        except command.CommandError as error:
            raise QgsProcessingException(str(error)) from error
        except command.Canceled:
            return {}
        return {OUTPUT: str(folder), **self.load(folder, parameters, context, feedback)}

    def load(
        self, folder: Path, parameters: Parameters, context: QgsProcessingContext, feedback: QgsProcessingFeedback
    ) -> dict[str, str]:
        """The source of each output, which QGIS loads if that was asked for."""
        layers = layers_of(folder)
        if not layers:
            feedback.pushWarning(f"{folder} has no layers that QGIS can load")
        if self.parameterAsBool(parameters, LOAD, context) and context.project():
            for layer in layers:
                _load_on_completion(layer, context)
        return {layer.output: layer.source for layer in reversed(layers)}  # the first of several

    def raster(self, parameters: Parameters, name: str, context: QgsProcessingContext) -> str:
        """The file of a raster layer."""
        layer = self.parameterAsRasterLayer(parameters, name, context)
        if layer is None:
            raise QgsProcessingException(self.invalidRasterError(parameters, name))
        return self.raster_file(layer)

    def raster_file(self, layer: QgsMapLayer) -> str:
        """The file of a raster layer. `QgsProcessingException` for layers of a service."""
        parts = QgsProviderRegistry.instance().decodeUri("gdal", layer.source())
        path = str(parts.get("path", ""))
        if layer.providerType() != "gdal" or parts.get("layerName") or not Path(path).is_file():
            raise QgsProcessingException(
                f"The layer {layer.name()} is not a raster file: export it first (Export > Save As)"
            )
        return path

    def layer(
        self, parameters: Parameters, name: str, context: QgsProcessingContext, feedback: QgsProcessingFeedback
    ) -> str:
        """A vector layer as FILE or FILE|layername=NAME. Layers that are no such file, filtered ones, and selections
        are exported."""
        path, table = self.parameterAsCompatibleSourceLayerPathAndLayerName(
            parameters, name, context, FORMATS, FORMATS[0], feedback
        )
        return f"{path}|layername={table}" if table and path.lower().endswith(".gpkg") else path

    def name(self) -> str:
        return self.NAME

    def displayName(self) -> str:
        return self.TITLE

    def shortHelpString(self) -> str:
        return self.HELP

    def icon(self) -> QIcon:
        return self.provider().icon() if self.provider() else QIcon()

    def createInstance(self) -> Zpm2Algorithm:
        return type(self)()


class _Styler(QgsProcessingLayerPostProcessorInterface):
    """Gives a loaded layer its style."""

    def __init__(self, style: Path) -> None:
        super().__init__()
        self.style = style

    def postProcessLayer(
        self, layer: QgsMapLayer, context: QgsProcessingContext, feedback: QgsProcessingFeedback
    ) -> None:
        message, good = layer.loadNamedStyle(str(self.style))
        if good:
            layer.triggerRepaint()
        else:
            feedback.pushWarning(f"The style {self.style.name} cannot be loaded: {message}")


_stylers: list[_Styler] = []  # contexts own and delete them, but do not keep their Python part alive


def _load_on_completion(layer: ResultLayer, context: QgsProcessingContext) -> None:
    details = QgsProcessingContext.LayerDetails(layer.name, context.project(), layer.output)
    _stylers.append(_Styler(layer.style))  # each layer has its own
    details.setPostProcessor(_stylers[-1])
    details.forceName = True
    context.addLayerToLoadOnCompletion(layer.source, details)


def choice(option: str, value: str) -> list[str]:
    """An option of the command with its value, or nothing where the value is that of the preset."""
    return [option, value] if value and value != PRESET else []
