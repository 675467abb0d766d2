"""Data sets in their publishers' folder layouts, opened by name and read lazily (paper 4.1). One file each."""

from zpm2.evaluate.datasets.registry import DATASETS, DatasetFormat, dataset, open_dataset

__all__ = ["DATASETS", "DatasetFormat", "dataset", "open_dataset"]
