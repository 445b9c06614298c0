"""The client of a session."""

from swarmseat.openenv import SwarmClient

__all__ = ["SwarmClient"]
