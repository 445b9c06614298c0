"""Client, PettingZoo environment and analysis for the server of SwarmBench (arXiv 2505.04364).

`Client` and `AsyncClient` speak its protocol, `Server` starts one on this machine, and `parallel_env` makes an
episode an environment for reinforcement learning. docs/play/python.md in the repository shows all of it. `analysis`
evaluates exported games (docs/evaluate/analysis.md).
"""

from importlib import import_module
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from . import wire
from .client import AsyncClient, Client
from .errors import (
    ApiError,
    ArgumentError,
    ConnectionFailedError,
    ServerError,
    SwarmbenchError,
    UnexpectedAnswerError,
    is_refused,
)
from .exchange import Event, Retry
from .loops import run_async
from .server import Server

if TYPE_CHECKING:
    from . import analysis
    from .environment import SwarmEnv, parallel_env
    from .native import VecEnv
    from .text import TextEpisode, Turn
    from .vector import gym_vector_env

__all__ = [
    "ApiError",
    "ArgumentError",
    "AsyncClient",
    "Client",
    "ConnectionFailedError",
    "Event",
    "Retry",
    "Server",
    "ServerError",
    "SwarmEnv",
    "SwarmbenchError",
    "TextEpisode",
    "Turn",
    "UnexpectedAnswerError",
    "VecEnv",
    "analysis",
    "gym_vector_env",
    "is_refused",
    "parallel_env",
    "run_async",
    "wire",
]

__version__ = version("swarmseat")


_NEEDS_RL = {
    "SwarmEnv": ".environment",
    "TextEpisode": ".text",
    "Turn": ".text",
    "VecEnv": ".native",
    "gym_vector_env": ".vector",
    "parallel_env": ".environment",
}
"""Names that need more than the client, by the module that has them."""


def __getattr__(name: str) -> Any:
    """Loads the environment and the analysis, and with them NumPy and others, only where they are used."""
    if name == "analysis":
        return import_module(".analysis", __name__)
    if name in _NEEDS_RL:
        try:
            module = import_module(_NEEDS_RL[name], __name__)
        except ModuleNotFoundError as error:
            if error.name == "swarmseat._native":
                raise
            raise ModuleNotFoundError(
                f"swarmseat.{name} needs {error.name}: install this package with its extra `rl` (docs/play/python.md)",
                name=error.name,
            ) from error
        return getattr(module, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
