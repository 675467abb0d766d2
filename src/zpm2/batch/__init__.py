"""Many pairs or groups of photographs: a list that is done by processes of one machine, by parts of it on several, or
by Ray, and one index."""

from zpm2.batch.engines.on_ray import RayEngine
from zpm2.batch.engines.processes import Processes
from zpm2.batch.entries import Group, Pair
from zpm2.batch.group_list import groups_of_folder, read_groups
from zpm2.batch.job import Job
from zpm2.batch.pair_list import pairs_of_folder, read_pairs
from zpm2.batch.runner import BatchSummary, merge, read_index, run, save_list
from zpm2.batch.tiles import TileEngine

__all__ = [
    "BatchSummary",
    "Group",
    "Job",
    "Pair",
    "Processes",
    "RayEngine",
    "TileEngine",
    "groups_of_folder",
    "merge",
    "pairs_of_folder",
    "read_groups",
    "read_index",
    "read_pairs",
    "run",
    "save_list",
]
