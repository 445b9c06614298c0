"""Small stand-ins for the frameworks, with the parts of them that the adapters use.

`.ci/frameworks` tests the adapters against the real packages. Stand-ins are used only if the real package is not
installed.
"""

import pickle
import sys
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict

A = TypeVar("A")
B = TypeVar("B")
C = TypeVar("C")


def install(package: str, modules: dict[str, dict[str, Any]]) -> None:
    """Makes modules importable, unless the package is installed."""
    if package in sys.modules or find_spec(package) is not None:
        return
    for name, members in {package: {}, **modules}.items():
        module = ModuleType(name)
        module.__path__ = []
        vars(module).update(members)
        sys.modules[name] = module


# verifiers


class TaskData(BaseModel):
    model_config = ConfigDict(frozen=True)
    idx: int | None = None
    name: str | None = None
    prompt: Any = None
    system_prompt: str | None = None


class Task(Generic[A]):
    def __init__(self, data: A, config: Any = None) -> None:
        self.data, self.config = data, config


class TasksetConfig(BaseModel):
    id: str = ""
    task: Any = None


class Taskset(Generic[A, B]):
    _bounded: bool | None = None

    def __init__(self, config: Any) -> None:
        self.config = config

    def load(self) -> Iterator[Any]:
        raise NotImplementedError

    def __iter__(self) -> Iterator[Any]:
        return self.load()


class HarnessConfig(BaseModel):
    id: str = ""


class Harness(Generic[A]):
    def __init__(self, config: Any) -> None:
        self.config = config

    def resolve_prompt(self, data: Any) -> tuple[str | None, Any]:
        return data.system_prompt, data.prompt


class SubprocessConfig(BaseModel):
    type: str = "subprocess"


class AgentConfig(BaseModel):
    harness: Any = None
    runtime: Any = None


class EnvConfig(BaseModel):
    taskset: Any = None


class Env(Generic[A]):
    def __init__(self, config: Any) -> None:
        self.config = config


@dataclass
class ProgramResult:
    exit_code: int
    stdout: str
    stderr: str


@dataclass
class Trace:
    """The record of a seat."""

    id: str
    rewards: dict[str, float] = field(default_factory=dict)
    metrics: dict[str, float] = field(default_factory=dict)
    info: dict[str, Any] = field(default_factory=dict)
    prompts: list[str] = field(default_factory=list)

    def record_reward(self, name: str, value: float, weight: float = 1.0) -> None:
        self.rewards[name] = value * weight

    def record_metric(self, name: str, value: float) -> None:
        self.metrics[name] = float(value)


class Agents:
    """The role `agent`, played by a function from a seat and its prompt to an answer; `None` ends its conversation."""

    def __init__(self, play: Callable[[int, str], str | None]) -> None:
        self.traces: list[Trace] = []
        self._play = play
        self.agent = self

    @asynccontextmanager
    async def interaction(self, task: Any) -> AsyncIterator[Any]:
        assert task.data.prompt is None
        seat = len(self.traces)
        trace = Trace(f"trace{seat}")
        self.traces.append(trace)

        async def turn(prompt: str) -> Any:
            trace.prompts.append(prompt)
            reply = self._play(seat, prompt)
            return SimpleNamespace(last_reply=reply or "", terminated=reply is None)

        yield SimpleNamespace(trace=trace, turn=turn)


def verifiers() -> None:
    names = (
        TaskData, Task, TasksetConfig, Taskset, HarnessConfig, Harness, SubprocessConfig, AgentConfig, EnvConfig, Env,
        ProgramResult, Trace, Agents,
    )  # fmt: skip
    install("verifiers", {
        "verifiers.v1": {**{one.__name__: one for one in names}, "ModelContext": object, "Runtime": object},
        "verifiers.v1.dialects": {}, "verifiers.v1.dialects.chat": {"message_to_wire": dict},
        "verifiers.v1.task": {"task_key": lambda data: repr(sorted(data.items()))},
    })  # fmt: skip
    sys.modules["verifiers"].v1 = sys.modules["verifiers.v1"]  # type: ignore[attr-defined]


# OpenEnv


class Action(BaseModel):
    model_config = ConfigDict(extra="forbid")
    metadata: dict[str, Any] = {}


class Observation(BaseModel):
    model_config = ConfigDict(extra="forbid")
    done: bool = False
    reward: float | None = None
    metadata: dict[str, Any] = {}


class State(BaseModel):
    model_config = ConfigDict(extra="allow")
    episode_id: str | None = None
    step_count: int = 0


class EnvironmentMetadata(BaseModel):
    name: str
    description: str
    version: str | None = None


class Environment(Generic[A, B, C]):
    SUPPORTS_CONCURRENT_SESSIONS = False


class EnvClient(Generic[A, B, C]):
    pass


@dataclass
class StepResult(Generic[A]):
    observation: A
    reward: float | None = None
    done: bool = False
    metadata: Any = None


def openenv() -> None:
    def create_app(factory: Any, action: Any, observation: Any, **named: Any) -> Any:
        return SimpleNamespace(factory=factory, action=action, observation=observation, **named)

    install("openenv", {
        "openenv.core": {"EnvClient": EnvClient}, "openenv.core.client_types": {"StepResult": StepResult},
        "openenv.core.env_server": {}, "openenv.core.env_server.http_server": {"create_app": create_app},
        "openenv.core.env_server.interfaces": {"Environment": Environment},
        "openenv.core.env_server.types": {
            "Action": Action, "EnvironmentMetadata": EnvironmentMetadata, "Observation": Observation, "State": State,
        },
    })  # fmt: skip


# PyTorch: the part that plays a policy, without learning


class Tensor(np.ndarray[Any, Any]):
    def float(self) -> "Tensor":
        return tensor(self.astype(np.float32))

    def exp(self) -> "Tensor":
        return tensor(np.exp(self))


def tensor(array: Any) -> Tensor:
    return np.asarray(array).view(Tensor)


class Module:
    def __call__(self, seen: Any) -> Any:
        return self.forward(seen)  # type: ignore[attr-defined]

    def parts(self) -> dict[str, Any]:
        return {name: part for name, part in vars(self).items() if isinstance(part, Module)}

    def state_dict(self) -> dict[str, NDArray[Any]]:
        return {f"{name}.{key}": own for name, part in self.parts().items() for key, own in part.state_dict().items()}

    def load_state_dict(self, state: dict[str, NDArray[Any]]) -> None:
        for name, part in self.parts().items():
            own = {key.removeprefix(f"{name}."): value for key, value in state.items() if key.startswith(f"{name}.")}
            part.load_state_dict(own)


class Linear(Module):
    def __init__(self, inputs: int, outputs: int) -> None:
        self.weight, self.bias = tensor(np.zeros((outputs, inputs), np.float32)), tensor(np.zeros(outputs, np.float32))

    def forward(self, seen: Any) -> Any:
        return seen @ self.weight.T + self.bias

    def state_dict(self) -> dict[str, NDArray[Any]]:
        return {"weight": self.weight, "bias": self.bias}

    def load_state_dict(self, state: dict[str, NDArray[Any]]) -> None:
        self.weight, self.bias = tensor(state["weight"]), tensor(state["bias"])


class ReLU(Module):
    def forward(self, seen: Any) -> Any:
        return np.maximum(seen, 0)


class Sequential(Module):
    def __init__(self, *layers: Module) -> None:
        vars(self).update({str(place): layer for place, layer in enumerate(layers)})

    def forward(self, seen: Any) -> Any:
        for layer in self.parts().values():
            seen = layer(seen)
        return seen


class Chance:
    def manual_seed(self, seed: int) -> "Chance":
        self.random = np.random.default_rng(seed)
        return self


def torch() -> None:
    def multinomial(chances: Any, count: int, *, generator: Chance) -> Tensor:
        draw = generator.random.choice
        return tensor([draw(len(row), count, p=np.float64(row) / np.float64(row).sum()) for row in chances])

    def log_softmax(values: Any, _: int) -> Any:
        return values - np.log(np.exp(values).sum(-1, keepdims=True))

    def load(file: Path, *, weights_only: bool) -> Any:
        assert weights_only
        return pickle.loads(file.read_bytes())

    def save(state: Any, file: Path) -> None:
        file.write_bytes(pickle.dumps(state))

    def orthogonal(weight: Tensor, gain: float) -> None:
        weight[:] = gain * np.random.default_rng(1).standard_normal(weight.shape) / np.sqrt(weight.shape[1])

    init = SimpleNamespace(orthogonal_=orthogonal, zeros_=lambda bias: bias.fill(0))
    install("torch", {
        "torch": {
            "Tensor": Tensor, "Generator": Chance, "from_numpy": tensor, "load": load, "save": save,
            "multinomial": multinomial, "log_softmax": log_softmax, "no_grad": lambda: lambda method: method,
            "optim": SimpleNamespace(Optimizer=object),
        },
        "torch.nn": {"Module": Module, "Linear": Linear, "ReLU": ReLU, "Sequential": Sequential, "init": init},
    })  # fmt: skip
