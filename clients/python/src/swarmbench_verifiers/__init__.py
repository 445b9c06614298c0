"""The name by which verifiers finds this package: `vf-eval swarmbench-verifiers`.

verifiers takes the name of a module, and the one taskset, environment and harness in its `__all__`. So they have a
module of their own; all of them are in `swarmbench.verifiers`.
"""

from swarmbench.verifiers import SwarmEnv, SwarmHarness, SwarmTaskset

__all__ = ["SwarmEnv", "SwarmHarness", "SwarmTaskset"]
