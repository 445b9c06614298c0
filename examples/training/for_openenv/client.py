"""The client of a session."""

from swarmbench.openenv import SwarmClient

__all__ = ["SwarmClient"]
