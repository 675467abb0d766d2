"""Which kind of part a name or a dotted path stands for."""

import inspect
from collections.abc import Mapping
from typing import Literal

from zpm2.errors import ConfigError, did_you_mean
from zpm2.evaluate.datasets import DATASETS
from zpm2.evaluate.datasets.registry import DatasetFormat
from zpm2.features.registry import METHODS
from zpm2.formats.registry import FORMATS, OutputFormat
from zpm2.plugins import Models, Registry, value_at
from zpm2.segment.registry import SEGMENTERS

Kind = Literal["segmenter", "point matcher", "data set", "format"]

REGISTRIES: Mapping[Kind, Models | Registry[DatasetFormat] | Registry[OutputFormat]] = {
    "segmenter": SEGMENTERS,
    "point matcher": METHODS,
    "data set": DATASETS,
    "format": FORMATS,
}


def kind_of(name: str) -> Kind:
    """The kind of a registered name, or of what lies at a dotted path: as it registered itself, else by its form.
    `ConfigError` for what is none."""
    if ":" not in name:
        for kind, registry in REGISTRIES.items():
            if name in registry:
                return kind
        known = [each for registry in REGISTRIES.values() for each in registry]
        raise ConfigError(
            f"unknown model, data set or format '{name}'{did_you_mean(name, known)}; there are: {', '.join(known)}; or "
            "give package.module:Class"
        )
    value = value_at(name, "plug-in")
    for kind, registry in REGISTRIES.items():
        if registry.holds(value):
            return kind
    if isinstance(value, OutputFormat):
        return "format"
    if isinstance(value, type):
        found: list[Kind] = [kind for kind, method in METHOD.items() if callable(getattr(value, method, None))]
        if len(found) == 1:
            return found[0]
    elif callable(value) and [*inspect.signature(value).parameters][:2] == ["root", "split"]:
        return "data set"
    raise ConfigError(
        f"{name} is no plug-in: give a class with the method segment or match, a function of root and split, or an "
        "OutputFormat; register other functions with @segmenter or @point_matcher"
    )


METHOD: Mapping[Kind, str] = {"segmenter": "segment", "point matcher": "match"}
