"""Options of commands whose work is spread over processes."""

from typing import TYPE_CHECKING, Annotated

import typer

from zpm2.cli.options import RUN, one_of
from zpm2.errors import ConfigError

if TYPE_CHECKING:
    from zpm2.batch.engines.engine import Engine

ENGINES = ("local", "ray")
Workers = Annotated[int, typer.Option(min=1, help="Processes, each with the models.", rich_help_panel=RUN)]
EngineName = Annotated[
    str,
    typer.Option(
        help="local: processes of this machine; ray: actors of Ray (extra ray).",
        rich_help_panel=RUN,
        autocompletion=one_of(lambda: ENGINES),
    ),
]
Address = Annotated[
    str | None, typer.Option(help="Ray cluster, or auto.  [default: start Ray here]", rich_help_panel=RUN)
]
Gpus = Annotated[
    float, typer.Option(min=0.0, help="GPUs of each Ray worker; four share one with 0.25.", rich_help_panel=RUN)
]


def check_engine(name: str, address: str | None, gpus: float) -> None:
    """`ConfigError` for an engine that does not exist, and for options of another one."""
    if name not in ENGINES:
        raise ConfigError(f"--engine {name}: give local or ray")
    if name == "local" and (address is not None or gpus):
        raise ConfigError("--address and --gpus are of --engine ray: give it, too")


def open_engine(name: str, workers: int, address: str | None, gpus: float) -> "Engine":
    """The engine of these options, checked before."""
    from zpm2 import batch

    return batch.Processes(workers) if name == "local" else batch.RayEngine(workers, address, gpus=gpus)
