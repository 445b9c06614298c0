"""The block for SkyRL in docs/play/frameworks.md, with the real `skyrl_gym`."""

import re
from pathlib import Path
from typing import Any

from model import reply

PAGE = Path(__file__).resolve().parents[4] / "docs" / "play" / "frameworks.md"


def main() -> None:
    import skyrl_gym

    (block,) = [block for block in re.findall(r"^```python\n(.*?)^```", PAGE.read_text(), re.DOTALL | re.MULTILINE)
                if "skyrl_gym" in block]  # fmt: skip
    names: dict[str, Any] = {"__name__": "swarm_seat"}
    exec(compile(block, str(PAGE), "exec"), names)
    skyrl_gym.register("swarm-seat", entry_point=names["SwarmSeat"])
    env = skyrl_gym.make("swarm-seat", extras={"seed": 27, "task": "Foraging"})
    prompt, _ = env.init([{"role": "user", "content": "Play."}])
    assert prompt[0]["content"] == "Play."
    total, steps, seen = 0.0, 0, prompt[-1]["content"]
    while True:
        step = env.step(reply(seen))
        total, steps = total + step["reward"], steps + 1
        if step["done"]:
            assert step["observations"] == []
            break
        (message,) = step["observations"]
        seen = message["content"]
    assert steps == 20
    assert step["metadata"]["seed"] == 27
    print(f"{steps} steps, reward {total}")
    env.close()


if __name__ == "__main__":
    main()
