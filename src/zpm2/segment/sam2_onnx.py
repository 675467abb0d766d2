"""SAM 2 (Ravi et al. 2024), the tiny one, as two graphs for ONNX Runtime: the smallest SAM 2 that needs no torch.

The encoder's file is in the format of ONNX Runtime itself, which no other program reads. The decoder predicts three
masks a prompt and takes boxes as two labelled points, as all SAM 2 do. Its input for an earlier mask is not used.
"""

from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from zpm2 import weights
from zpm2.config import SegmentConfig
from zpm2.cores import limit
from zpm2.errors import WeightsError
from zpm2.runtime import mark_networks_loaded
from zpm2.segment.mask_network import Array, MaskNetwork, Sight
from zpm2.weights import Progress

CUDA = "CUDAExecutionProvider"
PARTS = ("image_embed", "high_res_feats_0", "high_res_feats_1")


def open_network(
    config: SegmentConfig, device: str, download: Progress | None
) -> tuple[MaskNetwork[dict[str, Array]], list[str]]:
    """The network, and a note where the device is a GPU that ONNX Runtime cannot use."""
    import onnxruntime

    on_gpu = device == "cuda" and CUDA in onnxruntime.get_available_providers()
    notes = [] if on_gpu or device == "cpu" else ["sam2_tiny runs on the CPU; for the GPU: pip install onnxruntime-gpu"]
    if config.precision != "float32":
        notes.append("sam2_tiny runs in single precision, which its files are in (segment.precision)")
    mark_networks_loaded()
    return Sam2Onnx(onnxruntime, on_gpu, config.gpu_batch if on_gpu else config.cpu_batch, download), notes


class Sam2Onnx:
    """The encoder and the decoder. `WeightsError` where a file cannot be had or read."""

    sight = Sight(1024, stretched=True)

    def __init__(self, onnxruntime: ModuleType, on_gpu: bool, batch: int, download: Progress | None = None) -> None:
        self.batch = batch
        options = onnxruntime.SessionOptions()
        options.log_severity_level = 3  # errors, which become ours
        options.intra_op_num_threads = limit() or 0  # 0: as many as it wants
        providers = [CUDA, "CPUExecutionProvider"] if on_gpu else ["CPUExecutionProvider"]
        sessions = []
        for name in ("sam2_tiny_encoder", "sam2_tiny_decoder"):
            path = weights.get(name, progress=download)
            try:
                sessions.append(onnxruntime.InferenceSession(path, options, providers=providers))
            except Exception as error:  # of a kind for each of a dozen reasons
                reason = (str(error).splitlines() or [type(error).__name__])[0]
                raise WeightsError(f"ONNX Runtime {onnxruntime.__version__} cannot read {path}: {reason}") from error
        self.encoder, self.decoder = sessions

    def encode(self, pixels: Array) -> dict[str, Array]:
        return dict(zip(PARTS, self.encoder.run(PARTS, {"image": pixels}), strict=True))

    def decode(self, encoded: dict[str, Array], points: Array, labels: NDArray[np.int64]) -> tuple[Array, Array]:
        prompts = {
            "point_coords": points - np.float32(0.5),  # the graph counts from the centre of the first pixel
            "point_labels": np.tile(labels.astype(np.float32), (len(points), 1)),
            "mask_input": np.zeros((len(points), 1, 256, 256), np.float32),
            "has_mask_input": np.zeros(1, np.float32),
        }
        logits, iou = self.decoder.run(("masks", "iou_predictions"), {**encoded, **prompts})
        return iou, logits
