"""The example for TRL: the schemas that transformers makes of its tools, and the loop of the trainer without a model.

No PyTorch is needed, so the trainer itself is not run.
"""

import inspect
import json
import runpy
from pathlib import Path
from typing import Any

from transformers.utils.chat_template_utils import get_json_schema

EXAMPLE = Path(__file__).resolve().parents[4] / "examples" / "training" / "trl_grpo.py"


def tools(environment: Any) -> dict[str, Any]:
    """The tools that the trainer offers to the model: all public methods except two."""
    found = inspect.getmembers(type(environment), predicate=inspect.isfunction)
    names = [name for name, _ in found if not name.startswith("_") and name not in {"reset", "get_reward"}]
    return {name: getattr(environment, name) for name in names}


def main() -> None:
    example = runpy.run_path(str(EXAMPLE))
    environment = example["SwarmSeat"]()
    offered = tools(environment)
    assert sorted(offered) == ["look", "move", "say"], offered
    for tool in offered.values():
        schema = get_json_schema(tool)["function"]
        assert schema["description"]
        print(json.dumps(schema))
        for name, parameter in schema["parameters"]["properties"].items():
            assert parameter["description"], name
    rows = example["rows"]("Foraging", 2, first_seed=1)
    # A group of GRPO: the same row, and so the same layout, in pooled environments that are used again.
    pool = [environment, example["SwarmSeat"]()]
    for row in rows:
        first = {one.reset(**row) for one in pool}
        assert len(first) == 1
        for one in pool:
            for _ in range(example["MAX_ROUND"]):
                seen = tools(one)["move"](direction="RIGHT")
        assert "is over" in seen
        rewards = [one.get_reward() for one in pool]
        assert rewards[0] == rewards[1]
    print(f"rewards of a group: {rewards}")


if __name__ == "__main__":
    main()
