"""The list itself: complete, consistent, and as the documentation prints it."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from zpm2.errors import WeightsError
from zpm2.weights import MANIFEST, entry
from zpm2.weights.manifest import Carrier, Hub

UNKNOWN = (  # files that we have never seen
    *("sam2.1_tiny", "sam2.1_small", "sam2.1_base_plus", "sam2.1_large", "edgetam"),
    *("sam_hq_b", "sam_hq_l", "sam_hq_h", "sam3"),
    *("loftr_outdoor", "loftr_indoor", "efficientloftr", "superglue_outdoor", "superglue_indoor"),
)
NAMES = {
    *("mobile_sam", "sam_vit_b", "sam_vit_l", "sam_vit_h", "xfeat", "xfeat_lighterglue", "disk", "disk_lightglue"),
    *("sam2_tiny_encoder", "sam2_tiny_decoder", *UNKNOWN),
    *("aliked_n16", "aliked_n16rot", "aliked_n32", "aliked_lightglue", "superpoint", "superpoint_lightglue"),
    *("mccnn_middlebury", "mccnn_aerial"),
}


def test_every_entry_is_complete_and_distinct():
    assert {item.name for item in MANIFEST} == NAMES
    assert tuple(item.name for item in MANIFEST if not item.hash_known) == UNKNOWN
    known = [item for item in MANIFEST if item.hash_known]
    for what, items in (("name", MANIFEST), ("file", MANIFEST), ("sha256", known)):
        assert len({getattr(item, what) for item in items}) == len(items)
    for item in known:
        assert re.fullmatch(r"[0-9a-f]{64}", item.sha256)
        assert item.size > 1_000_000
    for item in MANIFEST:
        assert item.sources
        assert [type(source) for source in item.sources] in ([Hub], [Carrier], [Hub, Carrier])


def test_only_superpoint_and_superglue_need_acceptance():
    asked = {item.name for item in MANIFEST if not item.commercial_use}
    assert asked == {"superpoint", "superpoint_lightglue", "superglue_outdoor", "superglue_indoor"}


def test_unknown_name_says_what_there_is():
    with pytest.raises(
        WeightsError, match=r"unknown weights 'xfaet' \(did you mean 'xfeat'\?\); there are: mobile_sam"
    ):
        entry("xfaet")


def test_documentation_prints_the_manifest():
    text = (Path(__file__).parents[2] / "docs" / "weights.md").read_text(encoding="utf-8")
    rows = [line for line in text.splitlines() if re.match(r"\| [\w.]+ \| \S+ \| (\d+|unknown) ", line)]
    sizes = [(e.size or "unknown", e.sha256 or "unknown") for e in MANIFEST]
    assert rows == [
        f"| {e.name} | {e.file} | {size} | {sha256} | {e.licence} | {e.purpose} | {e.home} |"
        for e, (size, sha256) in zip(MANIFEST, sizes, strict=True)
    ]


def test_import_is_light():
    heavy = "{'torch', 'requests', 'huggingface_hub', 'pypi_simple'}"
    code = f"import sys, zpm2.weights; print({heavy} & set(sys.modules))"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert out.strip() == "set()"
