"""The other end of `zpm2.features.vismatch`: a script for a Python that has vismatch, and that need not have zpm2.

    python vismatch_worker.py MATCHER DEVICE MAX_KEYPOINTS FUNCTION...

Each FUNCTION of torch is called on one number first (`zpm2.runtime.settle_torch` says why). It answers on standard
output, which vismatch's own prints do not reach. A message is one line of JSON, then the bytes that it announces. First
comes {"ready": true}; then of each pair that is read, {"shapes": [[h, w], [h, w]]} and its uint8 RGB pixels,
{"points": n} and 5 n float64: x, y of the left and of the right image, score.
"""

import json
import os
import random
import sys


def main() -> None:
    """Answers pair by pair until standard input ends."""
    name, device, limit = sys.argv[1], sys.argv[2], int(sys.argv[3])
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    questions = sys.stdin.buffer
    import cv2
    import numpy as np
    import torch
    from vismatch import get_matcher

    for function in sys.argv[4:]:
        getattr(torch, function)(torch.full((1,), 0.5))
    torch.use_deterministic_algorithms(True, warn_only=True)
    matcher = get_matcher(name, device=device, max_num_keypoints=limit)
    answers.write(json.dumps({"ready": True}).encode() + b"\n")
    answers.flush()
    while line := questions.readline():
        images = []
        for height, width in json.loads(line)["shapes"]:
            pixels = np.frombuffer(questions.read(height * width * 3), np.uint8).reshape(height, width, 3)
            images.append(torch.from_numpy(pixels.transpose(2, 0, 1) / np.float32(255.0)))
        random.seed(0)  # RoMa and others draw their points from a dense map
        np.random.seed(0)  # noqa: NPY002 - what they draw from
        torch.manual_seed(0)
        cv2.setRNGSeed(0)
        found = matcher(*images)
        left, right = (np.asarray(found[f"matched_kpts{k}"], np.float64).reshape(-1, 2) for k in (0, 1))
        scores = found.get("matched_confidences")
        scores = np.ones(len(left)) if scores is None else np.asarray(scores, np.float64).reshape(-1)
        table = np.ascontiguousarray(np.c_[left, right, scores], np.float64)
        answers.write(json.dumps({"points": len(table)}).encode() + b"\n" + table.tobytes())
        answers.flush()


if __name__ == "__main__":
    main()
