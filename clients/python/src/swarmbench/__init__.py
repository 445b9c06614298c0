"""Client and PettingZoo environment for the swarmbench server.

`Client` and `AsyncClient` speak its protocol, `Server` starts one on this machine, and `parallel_env` makes an
episode an environment for reinforcement learning. docs/play/python.md in the repository shows all of it.
"""

from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from . import wire
from .client import AsyncClient, Client
from .errors import ApiError, ConnectionFailedError, ServerError, SwarmbenchError, UnexpectedAnswerError, is_problem
from .exchange import Event, Retry
from .server import Server

if TYPE_CHECKING:
    from .environment import SwarmEnv, parallel_env

__all__ = [
    "ApiError",
    "AsyncClient",
    "Client",
    "ConnectionFailedError",
    "Event",
    "Retry",
    "Server",
    "ServerError",
    "SwarmEnv",
    "SwarmbenchError",
    "UnexpectedAnswerError",
    "is_problem",
    "parallel_env",
    "wire",
]

__version__ = version("swarmbench")


def __getattr__(name: str) -> Any:
    """Loads the environment, and with it numpy and PettingZoo, only where it is used."""
    if name in {"SwarmEnv", "parallel_env"}:
        try:
            from . import environment  # noqa: PLC0415 - that is the purpose
        except ModuleNotFoundError as error:
            raise ModuleNotFoundError(
                f"swarmbench.{name} needs {error.name}: pip install 'swarmbench[rl]'", name=error.name
            ) from error
        return getattr(environment, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
