"""Configurations from files, from "stage.field=value" settings, and from options by their short names."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from zpm2.config.parse import known, overlay
from zpm2.config.whole import Config, describe
from zpm2.errors import ConfigError, did_you_mean
from zpm2.files.reading import read_json, read_toml

# What the command line and `zpm2.match` call the fields that are set most often.
OPTIONS = {
    "segmenter": "segment.model",
    "quality": "segment.quality",
    "detail": "segment.detail.level",
    "points": "points.methods",
    "tiles": "tiles.mode",
    "bands": "raster.bands",
    "gsd": "raster.gsd",
    "min_area_m2": "raster.min_area_m2",
    "estimator": "pose.estimator",
    "device": "device",
    "max_memory": "max_memory",
    "seed": "seed",
}


def load(path: str | Path, base: Config | None = None) -> Config:
    """A configuration from a .toml or .json file, laid over `base`."""
    path = Path(path)
    try:
        values = read_json(path) if path.suffix.lower() == ".json" else read_toml(path)
    except OSError as error:
        raise ConfigError(f"cannot read configuration {path}: {error.strerror}") from error
    except RecursionError as error:
        raise ConfigError(f"configuration {path} is nested too deeply: it holds stages with fields only") from error
    except ValueError as error:
        raise ConfigError(f"configuration {path} is not valid {path.suffix.lstrip('.') or 'TOML'}: {error}") from error
    if not isinstance(values, dict):
        raise ConfigError(f"configuration {path} must hold a table of stages, got {type(values).__name__}")
    return Config.from_dict(values, base)


def assign(config: Config, settings: Sequence[str]) -> Config:
    """`config` with each "stage.field=value" of `settings` applied (the command line's `--set`).

    >>> assign(Config(), ["segment.grid=16", "points.methods=sift,xfeat"]).points.methods
    ('sift', 'xfeat')
    """
    for setting in settings:
        key, equals, text = setting.partition("=")
        if not equals:
            raise ConfigError(f"--set {setting}: expected stage.field=value, for example segment.grid=16")
        config = Config.from_dict(_nested(key.strip(), text), config)
    return config


def with_options(config: Config, options: Mapping[str, object]) -> Config:
    """`config` with those `options`, by their names in `OPTIONS`, that are not None.

    >>> with_options(Config(), {"quality": "fast", "seed": None}).segment.quality
    'fast'
    """
    for name, value in options.items():
        if name not in OPTIONS:
            raise ConfigError(
                f"unknown option '{name}'{did_you_mean(name, OPTIONS)}; options are: {', '.join(OPTIONS)}"
            )
        if value is not None:
            config = Config.from_dict(_nested(OPTIONS[name], value), config)
    return config


def recorded(values: Mapping[str, object]) -> Config:
    """The configuration that a result holds; the default of each field that it lacks, or holds no valid value of.

    It forgives, and is the only reader of a result's configuration: what was matched stays good when another version
    named or limited a field differently, and fields are only needed to go on from there (outlines, maps, pictures). A
    configuration that a person writes is read strictly (`load`).

    >>> recorded({"segment": {"min_area": 7, "gird": 9}}).segment.min_area
    7.0
    """
    config = Config()
    with suppress(ConfigError):
        return overlay(config, known(config, values))
    for key, _, _, _ in describe(config):
        value: object = values
        for name in key.split("."):
            value = value.get(name) if isinstance(value, Mapping) else None
        if value is not None:
            with suppress(ConfigError):
                config = Config.from_dict(_nested(key, value), config)
    return config


def _nested(key: str, value: object) -> dict[str, object]:
    """The field "stage.field" as a nested mapping.

    >>> _nested("segment.grid", 16)
    {'segment': {'grid': 16}}
    """
    *stages, field = key.split(".")
    nested = {field: value}
    for stage in reversed(stages):
        nested = {stage: nested}
    return nested
