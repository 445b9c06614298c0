"""The environment."""

from swarmseat.openenv import SwarmEnvironment

__all__ = ["SwarmEnvironment"]
