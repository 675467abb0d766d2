"""SAM as a segmenter that takes prompts: a photograph is encoded once, each prompt predicts masks with scores.

Masks stay at the decoder's resolution, 256 px along the longer side, until the wanted ones are known. Only those are
brought to the image's resolution.
"""

from collections.abc import Callable, Mapping, Sequence
from importlib.util import find_spec

import numpy as np
from numpy.typing import NDArray

from zpm2 import weights
from zpm2.config import SegmentConfig
from zpm2.errors import ConfigError, MissingDependency
from zpm2.model import Image, Mask
from zpm2.segment import automatic
from zpm2.segment.mask_view import LITTLE_MEMORY, NETWORK_LOCK, Room, is_out_of_memory
from zpm2.segment.protocol import PromptedView
from zpm2.segment.sam_backend import WEIGHTS, SamBackend
from zpm2.segment.sam_input import reduced
from zpm2.segment.sam_openvino import OpenVinoBackend
from zpm2.segment.sam_torch import TorchBackend
from zpm2.segment.sam_view import SamView, encoder_scale


def open_backend(
    config: SegmentConfig, device: str, say: Callable[[str], None], download: weights.Progress | None = None
) -> SamBackend:
    """The configured backend ("auto": openvino on a CPU where it is installed, else torch).

    `say` receives a line when networks are converted, which takes half a minute once.
    """
    model, backend = config.model, config.backend
    if backend == "openvino" and device != "cpu":
        raise ConfigError(f"segment.backend openvino runs on the CPU only, the device is {device}; use --device cpu")
    installed = find_spec("openvino") is not None
    if backend == "openvino" and not installed:
        raise MissingDependency("segment.backend openvino needs openvino: pip install openvino")
    weights.get(WEIGHTS[model], progress=download)
    if device == "cpu" and installed and backend != "torch":
        return OpenVinoBackend(model, config.cpu_batch, say, config.precision)
    batch = config.cpu_batch if device == "cpu" else config.gpu_batch
    return TorchBackend(model, batch, device, config.precision)


class SamSegmenter:
    """SAM behind the `PromptedSegmenter` protocol. Loads its networks on first use and keeps them.

    `notes` tell the user how it runs. `say` receives a line when networks are converted, `progress` the share of an
    image's prompts that is done, 0..1, and `download` the bytes of missing weights.
    """

    def __init__(
        self,
        config: SegmentConfig,
        device: str = "cpu",
        say: Callable[[str], None] = lambda _: None,
        progress: Callable[[float], None] = lambda _: None,
        download: weights.Progress = lambda done, total: None,
    ) -> None:
        self.config, self.device = config, device
        self.say, self.progress, self.download = say, progress, download
        self.name: str = config.model
        self.notes: list[str] = []
        self._backend: SamBackend | None = None
        self._shared: Room | None = None  # of all views

    def load(self) -> SamBackend:
        """The networks, loaded (and converted, once per machine) at the first call."""
        config = self.config
        with NETWORK_LOCK:
            if self._backend is None:
                self._backend = open_backend(config, self.device, self.say, self.download)
                if config.backend == "auto" and self.device == "cpu" and self._backend.name == "torch":
                    self.notes.append("openvino is not installed, the segmenter runs in torch: pip install openvino")
            return self._backend

    def view(self, image: Image) -> SamView:
        """The photograph, encoded."""
        backend = self.load()
        return SamView(backend, image, self.config, self._room(backend))

    def views_together(self, images: Sequence[Image]) -> list[SamView]:
        """The photographs, encoded; on a GPU in one batch, or one by one where its memory ends, which a note says."""
        backend = self.load()
        if not isinstance(backend, TorchBackend) or not backend.resident:
            return [self.view(image) for image in images]
        room = self._room(backend)
        try:
            with NETWORK_LOCK:
                encoded = backend.images([reduced(image, encoder_scale(image)) for image in images])
        except RuntimeError as error:
            if not is_out_of_memory(error):
                raise
            note = f"{LITTLE_MEMORY}: photographs were encoded one at a time"
            if note not in self.notes:
                self.notes.append(note)
                self.say(note)
            return [self.view(image) for image in images]
        return [SamView(backend, image, self.config, room, each) for image, each in zip(images, encoded, strict=True)]

    def written(self, view: PromptedView) -> Mapping[str, NDArray[np.generic]] | None:
        """What a view keeps of the encoder's work; None in torch: on a GPU that takes no longer than a file."""
        assert isinstance(view, SamView)
        if not all(isinstance(part, np.ndarray) for part in view.parts):
            return None
        return {str(k): part for k, part in enumerate(view.parts)}

    def view_of_written(self, image: Image, arrays: Mapping[str, NDArray[np.generic]]) -> SamView:
        """The view again, with the same bytes."""
        backend = self.load()
        return SamView(backend, image, self.config, self._room(backend), parts=list(arrays.values()))

    def _room(self, backend: SamBackend) -> Room:
        if self._shared is None:
            self._shared = Room(backend.batch, self.notes)
        return self._shared

    def segment(self, image: Image) -> list[Mask]:
        """The regions, best score first."""
        return automatic.regions(self.view(image), self.config, self.progress)
