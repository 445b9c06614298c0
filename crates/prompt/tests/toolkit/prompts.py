"""Prints the prompts that a checkout's own code makes of observations: `prompts.py CHECKOUT`, JSON on both sides."""

import json
import sys
from pathlib import Path
from unittest import mock

sys.path.insert(0, str(Path(__file__).parents[4] / "examples" / "prompts"))
from from_toolkit import MEMORY, modules  # noqa: E402


class Cells:
    def __init__(self, rows):
        self.rows, self.shape = rows, (len(rows), len(rows[0]))

    def __getitem__(self, at):
        return self.rows[at[0]][at[1]]

    def __setitem__(self, at, cell):
        self.rows[at[0]][at[1]] = cell


def prompt(agents, tasks, seen):
    name = seen["agent"]
    task = getattr(tasks, seen["task"])(1)
    task.score = int(seen["score"])
    task.shape_desc = seen["shape"]
    task.agent_state, task.food_state = {name: seen["light_on"]}, {name: seen["carrying_food"]}
    player = agents.SwarmAgent(name, mock.MagicMock(), "", memory=MEMORY)
    with mock.patch("builtins.print"):
        player.to_action("")
    nothing = player.history.pop()
    for past in seen["history"]:
        action, said = past["action"] or nothing["action"], past["message"] or nothing["message"]
        player.history.append({"round": past["round"] + nothing["round"], "action": action, "message": said})
    *past, now = seen["views"]
    for view in past:
        player.views.append(agents.view2str(Cells(view["cells"]), view["at"]))
    y, x = now["at"]
    obs = {"task": task, "round": seen["round"], "view": Cells(now["cells"]), "name": name}
    return player.gen_prompt(obs | {"position": {"x": x, "y": y}}, dict(enumerate(seen["messages"])))


agents, tasks = modules(Path(sys.argv[1]).resolve())
print(json.dumps([prompt(agents, tasks, seen) for seen in json.load(sys.stdin)]))
