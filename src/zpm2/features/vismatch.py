"""The matchers of vismatch (RoMa, LoMa, MASt3R and some seventy more), each in a process of its own.

vismatch asks for an older kornia than zpm2 does: it lives in an environment of its own, whose Python
`ZPM2_VISMATCH_PYTHON` names. It fetches its weights itself, from its authors' hub, and asks that hub at each start.
"""

import json
import os
import subprocess
import tempfile
import weakref
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from zpm2.config import PointsConfig
from zpm2.cores import told
from zpm2.errors import MissingDependency, PointMatcherError
from zpm2.features.frame import Frame, frame
from zpm2.formats.convert import Members
from zpm2.model import Image, PointMatches
from zpm2.runtime import MKL_FUNCTIONS
from zpm2.weights.fetch import offline

PYTHON = "ZPM2_VISMATCH_PYTHON"
WORKER = Path(__file__).with_name("vismatch_worker.py")
INSTALL = (
    f"python -m venv FOLDER && FOLDER/bin/pip install vismatch, then set {PYTHON}=FOLDER/bin/python (on Windows "
    r"FOLDER\Scripts)"
)
CORNERS = ("loftr", "eloftr", "roma", "tiny-roma")


@dataclass(eq=False)
class VismatchMatcher:
    """The matcher `matcher` of vismatch. Its process starts at once and ends with this object.

    It sees images at `config.max_size` px or less. Most of its matchers count from pixel centres, those of `CORNERS`
    from pixel corners. Scores are the matcher's, 1 where it gives none.
    """

    matcher: str
    config: PointsConfig
    device: str
    name: str = "vismatch"
    _process: "subprocess.Popen[bytes]" = field(init=False, repr=False)

    def __post_init__(self) -> None:
        python = os.environ.get(PYTHON, "")
        if not python:
            raise MissingDependency(f"vismatch needs an environment of its own: {INSTALL}")
        command = [python, "-P", str(WORKER), self.matcher, self.device, str(self.config.max_keypoints), *MKL_FUNCTIONS]
        environment = os.environ | ({"HF_HUB_OFFLINE": "1"} if offline() else {})
        environment.pop("PYTHONPATH", None)
        if (threads := told()) is not None:
            environment["OMP_NUM_THREADS"] = str(threads)  # its torch does not know quotas of processor time
        self._said = tempfile.TemporaryFile()  # noqa: SIM115 - as long as the process
        pipe = subprocess.PIPE
        try:
            self._process = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=self._said, env=environment)
        except OSError as error:
            raise MissingDependency(f"{PYTHON} is {python}: {error.strerror}; vismatch needs {INSTALL}") from error
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._input, self._output = self._process.stdin, self._process.stdout
        weakref.finalize(self, _end, self._process)
        self._answer()  # it is ready

    def match(self, left: Image, right: Image) -> PointMatches:
        """See `PointMatcher.match`. At most `config.max_keypoints`, those of the best scores."""
        frames = [frame(side, self.config, "cpu") for side in (left, right)]
        if not all(side.useful.any() for side in frames):
            return PointMatches.empty()  # many of its matchers fail where there is nothing to see
        pixels = [_pixels(side) for side in frames]
        question = {"shapes": [each.shape[:2] for each in pixels]}
        try:
            self._input.write(json.dumps(question).encode() + b"\n" + b"".join(p.tobytes() for p in pixels))
            self._input.flush()
        except OSError:
            raise self._gone() from None
        count = int(self._answer()["points"])
        data = self._output.read(count * 40)
        if len(data) != count * 40:
            raise self._gone()
        table = np.frombuffer(data, np.float64).reshape(count, 5)
        return self._points(frames[0], frames[1], table[np.isfinite(table).all(1)])

    def match_many(self, pairs: Sequence[tuple[Image, Image]]) -> list[PointMatches]:
        """See `PointMatcher.match_many`; one at a time."""
        return [self.match(left, right) for left, right in pairs]

    def _points(self, left: Frame, right: Frame, table: NDArray[np.float64]) -> PointMatches:
        import torch

        shift = 0.5 if self.matcher in CORNERS else 0.0
        at = [torch.from_numpy(table[:, k : k + 2] - shift) for k in (0, 2)]
        useful = (left.is_useful(at[0]) & right.is_useful(at[1])).numpy()
        rows = np.flatnonzero(useful)
        rows = rows[np.argsort(-table[rows, 4], kind="stable")][: self.config.max_keypoints]
        score = np.clip(table[rows, 4], 0.0, 1.0)
        return PointMatches(left.to_image(at[0][rows]), right.to_image(at[1][rows]), score)

    def _answer(self) -> Members:
        line = self._output.readline()
        if not line:
            raise self._gone()
        answer: Members = json.loads(line)
        return answer

    def _gone(self) -> PointMatcherError:
        self._process.wait()
        self._said.seek(0)
        lines = [line for line in self._said.read().decode(errors="replace").splitlines() if line.strip()]
        why = lines[-1].strip()[:300] if lines else f"it ended with exit status {self._process.returncode}"
        if "No module named 'vismatch'" in why:
            return PointMatcherError(f"{os.environ[PYTHON]} has no vismatch: {INSTALL}")
        return PointMatcherError(f"vismatch's matcher '{self.matcher}' stopped: {why}")


def _pixels(seen: Frame) -> NDArray[np.uint8]:
    """(h, w, 3) RGB of a frame without its padding."""
    width, height = (round(side * factor) for side, factor in zip(seen.size, seen.scale, strict=True))
    rgb = seen.pixels[0, :, :height, :width].permute(1, 2, 0) * 255.0
    return np.ascontiguousarray(rgb.round().byte().numpy())


def _end(process: "subprocess.Popen[bytes]") -> None:
    process.kill()
    process.wait()
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            pipe.close()
