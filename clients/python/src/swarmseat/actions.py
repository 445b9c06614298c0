"""Actions of agents as numbers, and the spaces that contain them."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium import spaces

from .arrays import MESSAGE_CHARS_MAX, PRINTABLE
from .checks import shown, whole
from .errors import ArgumentError
from .names import actions_of
from .wire import SwarmAct


class Actions:
    """The actions of the agents of one task.

    Args:
        task: The task.
        num_agents: The number of agents.
        messages: Whether agents talk.
        control: Under `centralized` Agent_0 may name the receiver of its message.
    """

    def __init__(self, task: str, num_agents: int, messages: bool, control: str) -> None:
        self.names = actions_of(task)
        self._numbers = ", ".join(f"{number} {name}" for number, name in enumerate(self.names))
        self._num_agents = num_agents
        self._messages = messages
        self._commander = "Agent_0" if control == "centralized" else None

    def space(self, agent: str) -> spaces.Space[Any]:
        """The space of the agent's actions."""
        action: spaces.Space[Any] = spaces.Discrete(len(self.names))
        if not self._messages:
            return action
        parts = {"action": action, "message": spaces.Text(MESSAGE_CHARS_MAX, min_length=0, charset=PRINTABLE)}
        if agent == self._commander:
            # The only receiver of the commander's message; 0, the commander itself, stands for everybody.
            parts["to"] = spaces.Discrete(self._num_agents)
        return spaces.Dict(parts)

    def read(self, agent: str, action: Any, act: SwarmAct) -> None:
        """Writes an action into an act.

        Raises:
            ArgumentError: The action is not in the agent's space. Only a message may be longer: the server cuts it.
        """
        if not self._messages:
            act["action"] = self._name(agent, action)
            return
        known = {"action", "message", "to"} if agent == self._commander else {"action", "message"}
        if not isinstance(action, Mapping) or "action" not in action or not action.keys() <= known:
            raise ArgumentError(
                f"with messages=True an action of {agent} is a dictionary with {', '.join(map(repr, sorted(known)))}; "
                f"it is {shown(action)}"
            )
        act["action"] = self._name(agent, action["action"])
        message = action.get("message", "")
        if not isinstance(message, str):
            raise ArgumentError(f"the message of {agent} must be a text, '' for none; it is {shown(message)}")
        strange = sorted(set(message) - PRINTABLE)
        if strange:
            raise ArgumentError(
                f"the message of {agent} has {strange[0]!r}: in environments messages are of printable ASCII "
                "characters, the charset of the spaces"
            )
        if message:
            act["message"] = message
            to = whole(f"`to` of {agent}", _scalar(action.get("to", 0)), 0, self._num_agents - 1)
            if to:
                act["to"] = f"Agent_{to}"

    def _name(self, agent: str, action: Any) -> str:
        if isinstance(action, Mapping):
            raise ArgumentError(f"without messages=True an action is a number; that of {agent} is {shown(action)}")
        last = len(self.names) - 1
        return self.names[whole(f"the action of {agent} ({self._numbers})", _scalar(action), 0, last)]


def _scalar(value: Any) -> Any:
    """The element of a one-element array, which policies return as an action."""
    return value.item() if isinstance(value, np.ndarray) and value.size == 1 else value
