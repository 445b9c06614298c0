"""Swarms of language models as an OpenEnv environment."""

from .client import SwarmClient
from .models import SwarmAction, SwarmObservation, SwarmState

__all__ = ["SwarmAction", "SwarmClient", "SwarmObservation", "SwarmState"]
