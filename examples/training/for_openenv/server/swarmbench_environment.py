"""The environment."""

from swarmbench.openenv import SwarmEnvironment

__all__ = ["SwarmEnvironment"]
