"""Many pairs: a list that is done by processes of one machine, by parts of it on several, or by Ray, and one index."""

from zpm2.batch.engines.on_ray import RayEngine
from zpm2.batch.engines.processes import Processes
from zpm2.batch.job import Job
from zpm2.batch.pair_list import Pair, pairs_of_folder, read_pairs
from zpm2.batch.runner import BatchSummary, merge, read_index, run, save_list

__all__ = [
    "BatchSummary",
    "Job",
    "Pair",
    "Processes",
    "RayEngine",
    "merge",
    "pairs_of_folder",
    "read_index",
    "read_pairs",
    "run",
    "save_list",
]
