"""The name by which verifiers finds this package: `vf-eval swarmseat-verifiers`.

verifiers takes the name of a module, and the one taskset, environment and harness in its `__all__`. So they have a
module of their own; all of them are in `swarmseat.verifiers`.
"""

from swarmseat.verifiers import SwarmEnv, SwarmHarness, SwarmTaskset

__all__ = ["SwarmEnv", "SwarmHarness", "SwarmTaskset"]
