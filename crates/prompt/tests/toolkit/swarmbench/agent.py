"""A stand-in for the file of this name in the public toolkit: its structure, other words."""


def view2str(view_full, offset):
    height, width = view_full.shape
    top, left = offset[0] - height // 2, offset[1] - width // 2
    view_full[height // 2, width // 2] = "Y"
    text = "   " + " ".join(f"{left + j:>3}" for j in range(width)) + "\n"
    for i in range(height):
        text += f"{top + i:>3}  " + "".join(f"{view_full[i, j]:<4}" for j in range(width)) + "\n"
    return text


class SwarmAgent:
    def __init__(self, name, brain, sys_prompt, memory=5):
        self.name, self.memory = name, memory
        self.history, self.views = [], []

    def gen_prompt(self, obs, msgs):
        task, pos = obs["task"], obs["position"]
        self.views.append(view2str(obs["view"], (pos["y"], pos["x"])))
        labels = ["this round"] + [f"{n} round(s) before" for n in range(1, self.memory)]
        views = "\n".join(f"<{label}>\n{text}" for label, text in zip(labels, self.views[-self.memory:][::-1]))
        history = ""
        for entry in self.history[-self.memory:]:
            history += f"{entry['round']} -> {entry['action']}"
            if "message" in entry:
                history += f' saying "{entry["message"]}"'
            history += "\n"
        heard = "".join(f'Heard: "{text}"\n' for text in msgs.values())
        state = "\n".join(f"{name} = {value}" for name, value in task.task_obs(self).items())
        return f"""Hello {obs["name"]}, of {{many}}.

{task.desc()}

It is round {obs["round"]}. Your last {self.memory} views:
{views}

State:
{state}

Heard:
{heard}

Before:
{history}

Answer now. 100 %
"""

    def to_action(self, response):
        self.history.append({"round": len(self.history) + 1, "action": "NOTHING", "message": ""})
        return {}
