import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from zpm2.config import LocalConfig
from zpm2.global_match import Candidates
from zpm2.local_match import assignment, reference

CONFIG = LocalConfig()
GAMMA, EPSILON, UNMATCHED = CONFIG.gamma, CONFIG.epsilon, CONFIG.iota
seeds = st.integers(0, 10**6)


def cost(psi, dsf, texture):
    columns = np.array([psi], float), np.array([dsf]), np.array([texture], float)
    return float(assignment.matching_cost(*columns, CONFIG)[0])


def random_pairs(rng, m, n, share):
    """A sparse relation between m and n polygons whose rows are not 0, 1, 2, ..."""
    i, j = np.nonzero(rng.random((m, n)) < share)
    return Candidates.of(3 * i + 1, 2 * j + 5)


def as_costs(pairs, values):
    return dict(zip(zip(pairs.left.tolist(), pairs.right.tolist(), strict=True), values.tolist(), strict=True))


def solved(pairs, values, unmatched=UNMATCHED):
    """Energy and pairs of the fast solution, checked for what every solution must be."""
    rows = assignment.assign_optimal(pairs, values, unmatched)
    assert rows.dtype == np.int64
    assert np.array_equal(rows, np.unique(rows))
    assert len(set(pairs.left[rows])) == len(set(pairs.right[rows])) == len(rows)
    assert (values[rows] < unmatched).all()
    energy = values[rows].sum() + unmatched * (len(set(pairs.left)) - len(rows))
    return energy, set(zip(pairs.left[rows].tolist(), pairs.right[rows].tolist(), strict=True))


@given(st.floats(0, 1), st.integers(0, 200), st.floats(-1, 1))
def test_cost_is_the_reference(psi, dsf, texture):
    assert cost(psi, dsf, texture) == pytest.approx(reference.cost(psi, dsf, texture, GAMMA, EPSILON), rel=1e-12)


@given(st.floats(0.01, 0.98), st.integers(0, 100), st.floats(0.01, 0.98), st.floats(0.005, 0.02))
def test_cost_falls_with_every_kind_of_evidence(psi, dsf, texture, more):
    assert 0 < cost(psi + more, dsf, texture) < cost(psi, dsf, texture)
    if dsf >= GAMMA:
        assert cost(psi, dsf + 1, texture) < cost(psi, dsf, texture)
        assert cost(psi, dsf, texture + more) == cost(psi, dsf, texture)
    else:
        assert cost(psi, dsf, texture + more) < cost(psi, dsf, texture)


def test_the_branch_changes_at_gamma():
    assert cost(0.5, GAMMA, -1.0) == pytest.approx(1 / (0.5 * np.log(GAMMA + np.e) + EPSILON))
    assert cost(0.5, GAMMA - 1, 0.8) == pytest.approx(1 / (0.4 + EPSILON))


@given(st.floats(0, 1), st.floats(-1, 0))
def test_a_negative_correlation_never_attracts(psi, texture):
    assert cost(psi, 0, texture) == pytest.approx(1 / EPSILON)
    assert cost(psi, 0, texture) > UNMATCHED


@given(st.floats(0.01, 1), st.integers(0, 2 * GAMMA), st.floats(-1, 1))
def test_few_points_count_where_texture_says_less(psi, dsf, texture):
    columns = np.array([psi]), np.array([dsf]), np.array([texture])
    few = float(assignment.matching_cost(*columns, LocalConfig(few_points=True))[0])
    if dsf >= GAMMA or texture >= dsf / GAMMA or dsf == 0:
        assert few == cost(psi, dsf, texture)
    else:
        assert few == pytest.approx(1 / (psi * dsf / GAMMA + EPSILON))
        assert few < cost(psi, dsf, texture)


def test_without_a_threshold_points_always_decide():
    for few_points in (False, True):
        zeta = assignment.matching_cost(
            np.ones(2), np.array([0, 3]), np.zeros(2), LocalConfig(gamma=0, few_points=few_points)
        )
        assert zeta == pytest.approx(1 / (np.log(np.array([0, 3]) + np.e) + EPSILON))


@given(seeds, st.integers(1, 4), st.integers(1, 5), st.sampled_from([0.3, 0.7, 1.0]), st.booleans())
@settings(max_examples=60, deadline=None)
def test_optimal_is_the_best_of_all(seed, m, n, share, ties):
    rng = np.random.default_rng(seed)
    pairs = random_pairs(rng, m, n, share)
    values = (
        rng.integers(1, UNMATCHED + 2, len(pairs)).astype(float)
        if ties
        else rng.uniform(0.1, 1.3 * UNMATCHED, len(pairs))
    )
    energy, chosen = solved(pairs, values)
    for reference_energy, best in (
        reference.assign_exhaustive(as_costs(pairs, values), UNMATCHED),
        reference.assign_dense(as_costs(pairs, values), UNMATCHED),
    ):
        assert energy == pytest.approx(reference_energy)
        assert ties or chosen == best


@given(seeds, st.sampled_from([0.02, 0.05, 0.5]), st.sampled_from([0, 64]))
@settings(max_examples=40, deadline=None)
def test_components_and_both_solvers_reach_the_dense_optimum(seed, share, dense):
    rng = np.random.default_rng(seed)
    pairs = random_pairs(rng, int(rng.integers(1, 50)), int(rng.integers(1, 50)), share)
    values = rng.uniform(0.1, 1.3 * UNMATCHED, len(pairs))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(assignment, "DENSE_SIZE", dense)
        energy, chosen = solved(pairs, values)
    best_energy, best = reference.assign_dense(as_costs(pairs, values), UNMATCHED)
    assert energy == pytest.approx(best_energy)
    assert chosen == best


def test_a_component_larger_than_dense_takes_the_sparse_solver(monkeypatch):
    used = []
    sparse = assignment.min_weight_full_bipartite_matching
    monkeypatch.setattr(
        assignment, "min_weight_full_bipartite_matching", lambda graph: used.append(graph.shape) or sparse(graph)
    )
    n = assignment.DENSE_SIZE + 1
    i = np.arange(n)
    pairs = Candidates.of(np.r_[i, i[1:]], np.r_[i, i[1:] - 1])  # one chain
    rng = np.random.default_rng(0)
    values = rng.uniform(0.1, UNMATCHED, len(pairs))
    energy, chosen = solved(pairs, values)
    assert used == [(n, 2 * n)]
    assert (energy, chosen) == (
        pytest.approx(reference.assign_dense(as_costs(pairs, values), UNMATCHED)[0]),
        reference.assign_dense(as_costs(pairs, values), UNMATCHED)[1],
    )


def test_a_tentative_assignment_is_revoked():
    pairs = Candidates.of(np.array([0, 0, 1]), np.array([0, 1, 0]))
    values = np.array([1.0, 1.1, 1.2])  # 0-0, 0-1, 1-0: the cheapest pair must go
    assert solved(pairs, values, 5.0)[1] == {(0, 1), (1, 0)}
    psi = 1 / values
    assert assignment.assign_greedy(pairs, psi, values, 5.0).tolist() == [0]


def test_an_expensive_pair_stays_unmatched():
    pairs = Candidates.of(np.array([0, 1, 2]), np.array([0, 1, 2]))
    values = np.array([4.9, 5.0, np.inf])
    assert solved(pairs, values, 5.0)[1] == {(0, 0)}
    assert assignment.assign_greedy(pairs, np.ones(3), values, 5.0).tolist() == [0]


def test_no_pairs_no_assignment():
    none = Candidates.of(np.zeros(0, np.int64), np.zeros(0, np.int64))
    assert len(assignment.assign_optimal(none, np.zeros(0), 5.0)) == 0
    assert len(assignment.assign_greedy(none, np.zeros(0), np.zeros(0), 5.0)) == 0


@given(seeds, st.integers(1, 12), st.integers(1, 12))
@settings(max_examples=30, deadline=None)
def test_greedy_takes_the_most_similar_free_polygon(seed, m, n):
    rng = np.random.default_rng(seed)
    pairs = random_pairs(rng, m, n, 0.5)
    psi, values = rng.random(len(pairs)), rng.uniform(0.1, 1.3 * UNMATCHED, len(pairs))
    taken, expected = set(), []
    for i in np.unique(pairs.left):
        free = [k for k in np.flatnonzero(pairs.left == i) if pairs.right[k] not in taken and values[k] < UNMATCHED]
        if free:
            best = max(free, key=lambda k: psi[k])
            taken.add(pairs.right[best])
            expected.append(best)
    assert assignment.assign_greedy(pairs, psi, values, UNMATCHED).tolist() == expected
