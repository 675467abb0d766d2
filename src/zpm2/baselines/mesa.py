"""MESA: Zhang and Zhao, MESA: Matching Everything by Segmenting Anything, CVPR 2024: graphs of areas, cut."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import scipy.sparse
from scipy.sparse.csgraph import breadth_first_order, maximum_flow

from zpm2.baselines.area_graph import AreaGraph, area_graph
from zpm2.baselines.method import Checked, Pairing, RegionPair, greedy
from zpm2.config.fields import number, share
from zpm2.runtime import StageTimer

UNIT = 10**6  # whole units of capacity for an energy of 1: the library's maximum flow takes integers
Similar = list[dict[int, float]]  # of each region, the similarity to each region of the other image that has any


@dataclass(frozen=True)
class Mesa(Checked):
    """For each region, a cut through the other image's area graph finds candidates, and a global energy the best one.

    Cutting minimises the sum of 1 - similarity over the regions taken and of the similarity over those left, plus
    `smoothness` x IoU for each overlapping pair of which one is taken. Of several taken, the one with the least global
    energy counts: its own 1 - similarity, and the least one among both regions' parents, children and neighbours. Both
    directions are matched and put together.
    """

    name: ClassVar[str] = "mesa"
    uses_points: ClassVar[bool] = True
    notes: ClassVar[tuple[str, ...]] = (
        "mesa is our implementation of MESA's area matching (Zhang and Zhao, CVPR 2024) on our regions: similarity "
        "comes from shared homologous points in place of the trained network, as in the authors' training-free "
        "version; the Bayesian network has nothing to add to it, as no part of a region without shared points has "
        "any; regions of all sizes are matched, none is fused with or widened to another, and each is matched once",
    )
    min_similarity: float = share(0.1, "similarity below which it is 0", source="mesa-f.yaml, sigma_thd")
    smoothness: float = number(0.01, "weight of an overlap that is cut", source="mesa-f.yaml, adj_weight")
    max_energy: float = share(
        0.7,
        "energy up to which the best counts where the cut takes none",
        source="mesa-f.yaml, candi_energy_thd",
    )
    own: float = number(10.0, "weight of the pair's own energy", source="mesa-f.yaml, global_energy_weights")
    children: float = number(1.0, "weight of the energy of the regions inside", source="the same")
    parents: float = number(1.0, "weight of the energy of the regions around", source="the same")
    neighbours: float = number(1.0, "weight of the energy of the regions beside", source="the same")
    contained: float = share(0.8, "share of a child that lies in its parent", above=True, source="released code")

    def match(self, pair: RegionPair, stage: StageTimer) -> Pairing:
        """Both directions, put together one-to-one by the least energy."""
        with stage("graph"):
            left, right = (area_graph(side, self.contained) for side in pair.polygons)
            there, back = similarities(pair, self.min_similarity)
        with stage("cut"):
            found = dict(self._directed(there, left, right))
            for (j, i), least in self._directed(back, right, left):
                found[i, j] = min(least, found.get((i, j), np.inf))
        keys = sorted(found)
        rows = np.array(keys, np.int64).reshape(-1, 2)
        energy = np.array([found[key] for key in keys])
        kept = greedy(rows, -energy)
        return Pairing(rows[kept], energy[kept], 1 - energy[kept])

    def _directed(self, similar: Similar, source: AreaGraph, target: AreaGraph) -> list[tuple[tuple[int, int], float]]:
        """((i, j), energy): the region j of the other image that each region i finds."""
        found = []
        for i, row in enumerate(similar):
            taken = cut(row, target, self.smoothness)
            energies = [(self._energy(similar, source, target, i, j), j) for j in taken]
            if not taken:
                energies = [(1 - s, j) for j, s in row.items() if 1 - s <= self.max_energy]
            if energies:
                energy, j = min(energies)
                found.append(((i, j), energy))
        return found

    def _energy(self, similar: Similar, source: AreaGraph, target: AreaGraph, i: int, j: int) -> float:
        """The global energy of a pair, 0..1."""
        terms = [
            (self.own, 1 - similar[i][j]),
            (self.children, _least(similar, source.children[i], target.children[j])),
            (self.parents, _least(similar, source.parents[i], target.parents[j])),
            (self.neighbours, _least(similar, source.neighbours[i], target.neighbours[j])),
        ]
        return sum(weight * energy for weight, energy in terms) / max(sum(weight for weight, _ in terms), 1e-12)


def similarities(pair: RegionPair, least: float) -> tuple[Similar, Similar]:
    """0..1 for each pair of regions, as seen from either side: the share of the left region's points that lie in the
    right one, times the share of the right region's points that lie in the left one; divided by the greatest."""
    shared = pair.shared
    i, j = shared.pairs.left, shared.pairs.right
    value = shared.counts / shared.inside[0][i] * (shared.counts / shared.inside[1][j])
    enough = value >= least
    i, j, value = i[enough], j[enough], value[enough] / max(float(value.max(initial=0.0)), 1e-12)
    there: Similar = [{} for _ in range(len(pair.polygons[0]))]
    back: Similar = [{} for _ in range(len(pair.polygons[1]))]
    for a, b, s in zip(i.tolist(), j.tolist(), value.tolist(), strict=True):
        there[a][b] = back[b][a] = s
    return there, back


def cut(row: dict[int, float], graph: AreaGraph, smoothness: float) -> list[int]:
    """The regions that the least cut takes for one region with the similarities `row`.

    A region without similarity is never taken, as that costs 1, more than the overlaps it saves: so an overlap with it
    is a cost of taking the other one. Of equally good cuts, the one that takes fewest.
    """
    nodes = sorted(row)
    if not nodes:
        return []
    at = {j: k + 1 for k, j in enumerate(nodes)}  # 0 is the source, those it reaches are taken
    sink = len(nodes) + 1
    edges: dict[tuple[int, int], float] = {}
    for j in nodes:
        edges[0, at[j]] = row[j]
        edges[at[j], sink] = 1 - row[j]
        for other, iou in graph.iou[j].items():
            if other in at:
                edges[at[j], at[other]] = smoothness * iou
            else:
                edges[at[j], sink] += smoothness * iou
    ends = np.array(list(edges), np.int32)
    capacity = np.round(np.array(list(edges.values())) * UNIT).astype(np.int32)
    network = scipy.sparse.csr_array((capacity, ends.T), shape=(sink + 1, sink + 1))
    residual = scipy.sparse.csr_array(network - maximum_flow(network, 0, sink).flow)
    residual.data[residual.data < 0] = 0
    residual.eliminate_zeros()
    reached = set(breadth_first_order(residual, 0, return_predecessors=False).tolist())
    return [j for j in nodes if at[j] in reached]


def _least(similar: Similar, first: set[int], second: set[int]) -> float:
    """The least 1 - similarity of a region of `first` with one of `second`; 1 where there is none."""
    return 1 - max((s for i in first for j, s in similar[i].items() if j in second), default=0.0)
