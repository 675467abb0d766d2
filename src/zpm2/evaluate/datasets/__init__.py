"""Data sets in their publishers' folder layouts, opened by name and read lazily (paper 4.1). One file each."""

import pkgutil
from importlib import import_module

from zpm2.evaluate.datasets.registry import DATASETS, DatasetFormat, dataset, open_dataset

__all__ = ["DATASETS", "DatasetFormat", "dataset", "open_dataset"]

for _module in pkgutil.iter_modules(__path__):
    import_module(f"{__name__}.{_module.name}")
