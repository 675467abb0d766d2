"""Point voting."""

from region_pairs import found, grid, points, region_pair, squares

from zpm2.baselines import Vote


def test_mutual_best_by_the_share_of_points():
    # a nest of two squares in both images: the big ones share all points of the small ones, too
    boxes = (0, 0, 100), (10, 10, 20), (150, 150, 40)
    matches = points(grid(0, 0, 100, 10), grid(0, 0, 100, 10))
    result = found(Vote(), region_pair(squares(*boxes), squares(*boxes), matches))
    assert result == {(0, 0): 1.0, (1, 1): 1.0}  # the third one has no points


def test_the_score_is_the_iou_of_the_points():
    left, right = squares((0, 0, 50)), squares((0, 0, 50))
    inside, other = grid(0, 0, 50, 2), grid(100, 100, 50, 1)
    matches = points([*inside, *inside[:2], *other], [*inside, *other, *other, *inside[:1]])
    result = found(Vote(), region_pair(left, right, matches))
    assert result == {(0, 0): 4 / 7}  # 4 in both, 2 leave it, 1 comes from elsewhere


def test_fewer_points_than_asked_for_are_no_vote():
    matches = points(grid(0, 0, 50, 2), grid(0, 0, 50, 2))
    pair = region_pair(squares((0, 0, 50)), squares((0, 0, 50)), matches)
    assert found(Vote(min_points=4), pair)
    assert not found(Vote(min_points=5), pair)


def test_nothing_to_match():
    assert not found(Vote(), region_pair([], []))
    assert not found(Vote(), region_pair(squares((0, 0, 50)), []))
