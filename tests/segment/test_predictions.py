import numpy as np

from zpm2.segment.predictions import CORNER, INSIDE, MASK_SIDE, OTHER_CORNER, MaskPredictions, MaskThresholds, Prompts


def some(prompt, score, stability):
    logits = np.zeros((len(prompt), MASK_SIDE, MASK_SIDE), np.float16)
    logits[:, 0, 0] = np.arange(len(prompt)) - 0.5
    return MaskPredictions(np.array(prompt), np.array(score, np.float32), np.array(stability, np.float32), logits)


def test_prompts():
    points = np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]])
    prompts = Prompts.at(points)
    assert len(prompts) == 3
    assert prompts.points.shape == (3, 1, 2)
    assert list(prompts.labels) == [INSIDE]
    assert (prompts[1:].points[:, 0] == points[1:]).all()
    boxed = Prompts(np.zeros((2, 3, 2)), np.array([INSIDE, CORNER, OTHER_CORNER]))
    assert (boxed[:1].labels == boxed.labels).all()


def test_answers():
    predictions = some([0, 0, 2], [0.9, 0.6, 0.8], [0.99, 0.99, 0.5])
    assert list(predictions.passing(MaskThresholds(0.7, 0.9))) == [True, False, False]
    assert list(predictions.passing(MaskThresholds(0.6, 0.5))) == [True, True, True]
    assert list(predictions.bits[:, 0, 0]) == [False, True, True]
    assert list(predictions[predictions.score > 0.7].prompt) == [0, 2]
    joined = MaskPredictions.join(
        [predictions, MaskPredictions.none((MASK_SIDE, MASK_SIDE)), predictions[np.array([2])]]
    )
    assert list(joined.prompt) == [0, 0, 2, 2]
    assert np.array_equal(joined.logits[2], joined.logits[3])
    assert len(MaskPredictions.none((MASK_SIDE, MASK_SIDE))) == 0
    assert MaskPredictions.none((20, MASK_SIDE)).bits.shape == (0, 20, MASK_SIDE)


def test_chosen_rows_of_several_parts():
    parts = [
        some([4, 5], [0.9, 0.6], [1, 1]),
        MaskPredictions.none((MASK_SIDE, MASK_SIDE)),
        some([6, 7, 8], [0.5] * 3, [1] * 3),
    ]
    for rows in ([3, 0, 4, 0, 1], [2], []):
        found = MaskPredictions.chosen(parts, np.array(rows, np.intp))
        expected = MaskPredictions.join(parts)[np.array(rows, np.intp)]
        assert np.array_equal(found.prompt, expected.prompt)
        assert np.array_equal(found.score, expected.score)
        assert np.array_equal(found.logits, expected.logits)
