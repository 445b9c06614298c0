"""The shapes of actions, observations and states."""

from swarmseat.openenv import SwarmAction, SwarmObservation, SwarmState

__all__ = ["SwarmAction", "SwarmObservation", "SwarmState"]
