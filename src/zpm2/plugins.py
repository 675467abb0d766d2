"""Parts by name: segmenters, point matchers, data sets and formats, our own and those of other packages.

A part has one of four origins, and all are used alike:

- built in: a module in the folder of its kind registers it;
- a package that is installed and offers it under the entry-point group of its kind ("zpm2.segmenters", ...);
- a module that was imported and registered it;
- a dotted path, "package.module:Class", which is imported when it is asked for.

Installed packages are looked at only where a name is not built in, or where all are wanted. One that cannot be used
costs a warning line and nothing else, until it is asked for by name. docs/plugins.md has a template of each kind.
"""

import inspect
import pkgutil
import threading
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from zpm2.errors import ConfigError, MissingDependency, PluginWarning, Zpm2Error, did_you_mean
from zpm2.files.keys import code_of

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

Part = TypeVar("Part")
Maker = TypeVar("Maker", bound=Callable[..., Any])

BUILT_IN = "built in"
DOTTED = "dotted path"
USUAL = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)


@dataclass(frozen=True)
class ModelInfo:
    """What a user wants to know of a segmenter or a point matcher before it is used (`zpm2 models`)."""

    task: str = ""  # what it finds, in a few words
    code_licence: str = "unknown"
    weights_licence: str = ""  # empty: that of `weights` in the manifest
    training_data: str = "unknown"
    weights: tuple[str, ...] = ()  # names in `zpm2.weights.MANIFEST`
    input_size: str = "any"  # the size of image that it was trained for
    bytes_per_pixel: float = 0.0  # memory at its peak, for each pixel of a photograph as it sees it; 0: not measured
    working_bytes: float = 0.0  # the same, whatever the size of the photograph
    longest_side: int = 0  # points: px, the longer side that it was trained for, see `PointsConfig.side`; 0: any
    full_size: bool = False  # points: it sees photographs as they are, and not at `PointsConfig.max_size`
    extra: str = ""  # of zpm2, which installs the packages that it needs
    packages: tuple[str, ...] = ()  # what that extra brings, by the names that are imported
    variable: str = ""  # of the environment, which must be set
    device: str = "cpu, cuda"  # where it runs

    def missing_packages(self) -> list[str]:
        """Those of `packages` that are not installed."""
        return [package for package in self.packages if find_spec(package) is None]

    @property
    def install(self) -> str:
        """The command that installs `packages`."""
        return f'pip install "zpm2[{self.extra}]"' if self.extra else f"pip install {' '.join(self.packages)}"


@dataclass(frozen=True)
class Model:
    """A registered segmenter or point matcher."""

    name: str
    build: Callable[..., Any]  # the class or function that makes it, see `Models.build`
    info: ModelInfo = ModelInfo()


@dataclass(frozen=True)
class _Registered(Generic[Part]):
    part: Part
    source: Any  # the class, function or value that was registered
    origin: str
    module: str


class Registry(Generic[Part]):
    """The parts of one kind, by name.

    `kind` and `kinds` are what messages call one of them and several; `group` is that of entry points; `folder` is the
    package whose modules register the built-in ones. `adopt(name, value)` makes a part of a value that did not register
    itself, and raises `ConfigError` for one that can be none.
    """

    def __init__(self, kind: str, kinds: str, group: str, folder: str, adopt: Callable[[str, Any], Part]) -> None:
        self.kind, self.kinds, self.group, self.folder, self.adopt = kind, kinds, group, folder, adopt
        self._parts: dict[str, _Registered[Part]] = {}
        self._at_paths: dict[str, _Registered[Part]] = {}
        self._built_in_loaded = False
        self._known_offers: dict[str, list[EntryPoint]] | None = None  # by name; None: not read yet
        self._importing = ""  # the package that is being imported, while it is
        self._warned: set[str] = set()
        self._lock = threading.RLock()

    def register(self, name: str, part: Part, source: Any, module: str) -> None:
        """Add a part which `source` is or makes, from a module. `ValueError` for a taken name."""
        built_in = module.startswith("zpm2.")
        if not built_in:
            self._load_built_in()
        if name in self._parts:
            raise ValueError(
                f"two {self.kind}s have the name '{name}': one is {_whose(self._parts[name])}, the other is of the "
                f"module {module}; rename one"
            )
        origin = BUILT_IN if built_in else self._importing or f"module {module}"
        self._parts[name] = _Registered(part, source, origin, module)

    def remove(self, name: str) -> None:
        """Forget a part that a module registered."""
        self._parts.pop(name, None)

    def names(self) -> list[str]:
        """The names of all parts: built-in ones in the order of their modules, then the others by name. Installed
        packages are not imported for this."""
        self._load_built_in()
        own = sorted((p.module, k, name) for k, (name, p) in enumerate(self._parts.items()) if p.origin == BUILT_IN)
        built_in = [name for _, _, name in own]
        return built_in + sorted({*self._parts, *self._offers()} - set(built_in))

    def get(self, name: str) -> Part:
        """The part of that name, or at that dotted path. `ConfigError` where there is none, or it cannot be loaded."""
        return self._get(name).part

    def origin(self, name: str) -> str:
        """Where a part comes from: built in, a package and its version, a module, or a dotted path."""
        return self._get(name).origin

    def code(self, name: str) -> str:
        """A hash of the source of a part that is not built in, for resume keys; else nothing."""
        found = self._get(name)
        return "" if found.origin == BUILT_IN else code_of(found.module)

    def items(self) -> list[tuple[str, Part]]:
        """The names and the parts. One that cannot be loaded is left out, with one `PluginWarning`."""
        found = []
        for name in self.names():
            try:
                found.append((name, self.get(name)))
            except ConfigError as error:
                self._warn(str(error))
        return found

    def values(self) -> list[Part]:
        """The parts of `items`."""
        return [part for _, part in self.items()]

    def holds(self, value: Any) -> bool:
        """Whether that class, function or value has registered itself."""
        return any(each.source is value for each in self._parts.values())

    def unknown(self, name: str, more: Sequence[str] = ()) -> ConfigError:
        """The error for a name that no part has. `more` names would have done, too."""
        known = [*self.names(), *more]
        return ConfigError(
            f"unknown {self.kind} '{name}'{did_you_mean(name, known)}; {self.kinds} are: {', '.join(known)}"
        )

    def __iter__(self) -> Iterator[str]:
        return iter(self.names())

    def __len__(self) -> int:
        return len(self.names())

    def __contains__(self, name: object) -> bool:
        """Whether something can be asked for by that name: any dotted path can."""
        self._load_built_in()
        return isinstance(name, str) and (":" in name or name in self._parts or name in self._offers())

    def _get(self, name: str) -> _Registered[Part]:
        self._load_built_in()
        if name in self._parts:
            return self._parts[name]
        with self._lock:
            if ":" in name:
                return self._at_path(name)
            offers = self._offers().get(name)
            if offers is None:
                raise self.unknown(name)
            return self._parts.get(name) or self._of_package(name, offers)

    def _load_built_in(self) -> None:
        if self._built_in_loaded:
            return
        with self._lock:
            if not self._built_in_loaded:
                for module in pkgutil.iter_modules(import_module(self.folder).__path__):
                    import_module(f"{self.folder}.{module.name}")
                self._built_in_loaded = True

    def _offers(self) -> "dict[str, list[EntryPoint]]":
        """What installed packages offer, by name, without the names that are built in."""
        with self._lock:
            if self._known_offers is None:
                from importlib.metadata import entry_points  # 10 ms

                offers: dict[str, list[EntryPoint]] = {}
                for offer in sorted(entry_points(group=self.group), key=lambda o: (o.name, o.value)):
                    taken = self._parts.get(offer.name)
                    if taken is not None and taken.origin == BUILT_IN:
                        self._warn(
                            f"{self.kind} '{offer.name}' of {_package(offer)} is left out, the name is {_whose(taken)}"
                            f": use it as {offer.value}"
                        )
                    else:
                        offers.setdefault(offer.name, []).append(offer)
                self._known_offers = offers
            return self._known_offers

    def _of_package(self, name: str, offers: "list[EntryPoint]") -> _Registered[Part]:
        if len(offers) > 1:
            whose = " and ".join(f"{_package(offer)} ({offer.value})" for offer in offers)
            raise ConfigError(f"several {self.kind}s have the name '{name}': {whose}; use the path of one instead")
        self._importing = package = _package(offers[0])
        what = f"{self.kind} '{name}' of {package}"
        try:
            value = offers[0].load()
        except (Exception, SystemExit) as error:  # whatever another package may raise
            raise ConfigError(f"{what} cannot be loaded: {_told(error)}; repair that package or remove it") from error
        finally:
            self._importing = ""
        if name not in self._parts:  # it did not register itself by that name
            self._parts[name] = self._of_value(name, value, package)
        return self._parts[name]

    def _at_path(self, path: str) -> _Registered[Part]:
        if path not in self._at_paths:
            value = value_at(path, self.kind)
            self._at_paths[path] = self._of_value(path, value, DOTTED)
        return self._at_paths[path]

    def _of_value(self, name: str, value: Any, origin: str) -> _Registered[Part]:
        """What registered itself as another name, or has to be adopted."""
        for other in self._parts.values():
            if other.source is value:
                return other
        return _Registered(self.adopt(name, value), value, origin, module_of(value))

    def _warn(self, text: str) -> None:
        if text not in self._warned:
            self._warned.add(text)
            warnings.warn(text, PluginWarning, stacklevel=3)


class Models(Registry[Model]):
    """The segmenters or the point matchers.

    `given` names what a class or function may ask for by the names of its parameters; all its other parameters are
    options that the user sets, in the mapping of the configuration that `options_key` names ("segment.options").
    """

    def __init__(self, kind: str, kinds: str, group: str, folder: str, given: Sequence[str], options_key: str) -> None:
        super().__init__(kind, kinds, group, folder, self._adopted)
        self.given, self.options_key = given, options_key

    def add(self, name: str, info: ModelInfo) -> Callable[[Maker], Maker]:
        """Registers the class or function below it. `ValueError` for a taken name."""

        def register(build: Maker) -> Maker:
            self.register(name, Model(name, build, info), build, module_of(build))
            return build

        return register

    def check(self, names: Iterable[str], options: Mapping[str, Any]) -> None:
        """`ConfigError` for a name that does not exist, an option that none of these takes, and one that is missing."""
        parameters = {name: self._parameters(self.get(name).build) for name in names}
        taken = [option for own in parameters.values() for option in own]
        free = any(p.kind is p.VAR_KEYWORD for own in parameters.values() for p in own.values())
        for option in options:
            if option not in taken and not free:
                raise ConfigError(
                    f"unknown option '{self.options_key}.{option}'{did_you_mean(option, taken)}; "
                    f"{' and '.join(parameters)} {'takes' if len(parameters) == 1 else 'take'}: "
                    f"{', '.join(dict.fromkeys(taken)) or 'no options'}"
                )
        for name, own in parameters.items():
            for option, parameter in own.items():
                if parameter.kind in USUAL and parameter.default is parameter.empty and option not in options:
                    raise ConfigError(
                        f"{self.kind} '{name}' needs a value of its option {option}: --set "
                        f"{self.options_key}.{option}=VALUE"
                    )

    def build(self, name: str, given: Mapping[str, Any], options: Mapping[str, Any]) -> Any:
        """The segmenter or matcher `name`: its class or function, called with those of `given` and of `options` that it
        has parameters for. `MissingDependency` without the packages that it needs, `ConfigError` where one of another
        package fails."""
        found = self._get(name)
        if missing := found.part.info.missing_packages():
            raise MissingDependency(f"{self.kind} '{name}' needs {' and '.join(missing)}: {found.part.info.install}")
        kinds = [parameter.kind for parameter in _signature(found.part.build)]
        names = {parameter.name for parameter in _signature(found.part.build)}
        takes_any = inspect.Parameter.VAR_KEYWORD in kinds
        words = {key: value for key, value in given.items() if key in names}
        words |= {key: value for key, value in options.items() if key in names or takes_any}
        if found.origin == BUILT_IN:
            return found.part.build(**words)
        try:
            return found.part.build(**words)
        except Zpm2Error:
            raise
        except Exception as error:  # whatever another package may raise
            raise ConfigError(f"{self.kind} '{name}' ({found.origin}) cannot be built: {_told(error)}") from error

    def _parameters(self, build: Callable[..., Any]) -> dict[str, inspect.Parameter]:
        """The options that a class or function takes, by name."""
        usual = (*USUAL, inspect.Parameter.VAR_KEYWORD)
        return {p.name: p for p in _signature(build) if p.kind in usual and p.name not in self.given}

    def _adopted(self, name: str, value: Any) -> Model:
        if not callable(value):
            raise ConfigError(f"{self.kind} '{name}' is a {type(value).__name__}: give a class, or a function")
        return Model(name, value)


class WrongAnswer(Exception):
    """What a segmenter or matcher returned cannot be used. The text goes on after "returned"."""


@contextmanager
def answering(part: object, kind: str, error: type[Zpm2Error]) -> Iterator[None]:
    """Around a call of a segmenter or matcher and the checks of what it returns: a `WrongAnswer`, and what the code of
    others raises, become an `error` that names the part."""
    name = getattr(part, "name", type(part).__name__)
    try:
        yield
    except WrongAnswer as wrong:
        raise error(f"{kind} '{name}' returned {wrong} (python -m zpm2.contract checks one)") from wrong
    except (Zpm2Error, MemoryError):
        raise
    except Exception as problem:  # whatever another package may raise
        if module_of(type(part)).startswith("zpm2."):
            raise
        raise error(f"{kind} '{name}' raised {_told(problem)}") from problem


def listed(answer: object, wanted: str) -> list[Any]:
    """What was returned, as a list; `WrongAnswer` that says what is `wanted` where it is nothing of the kind."""
    if not isinstance(answer, Iterable):
        raise WrongAnswer(f"a {type(answer).__name__} instead of a list of {wanted}")
    return list(answer)


def value_at(path: str, kind: str) -> Any:
    """What lies at a dotted path, "package.module:Class"; `ConfigError` that names the `kind` where it cannot be
    loaded."""
    module, _, attribute = path.partition(":")
    try:
        value: Any = import_module(module)
        for name in attribute.split("."):
            value = getattr(value, name)
    except (Exception, SystemExit) as error:  # whatever another package may raise
        raise ConfigError(
            f"{kind} '{path}' cannot be loaded: {_told(error)}; give package.module:Class of a module that Python "
            "finds (an installed one, or one in a folder of PYTHONPATH)"
        ) from error
    return value


def module_of(source: Any) -> str:
    """The module that a class or function was defined in."""
    source = source.func if isinstance(source, partial) else source
    module = inspect.getmodule(source)
    return "__main__" if module is None else module.__name__


def _signature(build: Callable[..., Any]) -> list[inspect.Parameter]:
    try:
        return list(inspect.signature(build).parameters.values())
    except ValueError:  # of classes written in C
        return []


def _package(offer: "EntryPoint") -> str:
    return "an unnamed package" if offer.dist is None else f"package {offer.dist.name} {offer.dist.version}"


def _whose(part: _Registered[Any]) -> str:
    return part.origin if part.origin == BUILT_IN else f"of the {part.origin}"


def _told(error: BaseException) -> str:
    """An error of any kind in one line."""
    text = " ".join(str(error).split())
    return text if isinstance(error, Zpm2Error) and text else f"{type(error).__name__}: {text}".rstrip(": ")
