"""Plays one seat to the end: SWARMBENCH_URL=… SWARMBENCH_TOKEN=seat_… python minimal.py"""

import swarmseat


def decide(obs):
    if "SWITCH" in obs["actions"]:  # All lights on in even rounds, off in odd ones: all share the round as a clock.
        return "STAY" if obs["light_on"] == (obs["round"] % 2 == 0) else "SWITCH"
    wanted = "N" if obs.get("carrying_food") else "FPB"
    row, column = obs["position"]["i"] - obs["view"]["origin"]["i"], obs["position"]["j"] - obs["view"]["origin"]["j"]
    cells = [(i - row, j - column, cell) for i, line in enumerate(obs["view"]["cells"]) for j, cell in enumerate(line)]
    targets = [(i, j) for i, j, cell in cells if cell in wanted]
    if not targets:  # Wander, each agent in another direction.
        return obs["actions"][(obs["round"] // 6 + int(obs["agent"].removeprefix("Agent_"))) % 4]
    i, j = min(targets, key=lambda target: abs(target[0]) + abs(target[1]))
    return ("DOWN" if i > 0 else "UP") if abs(i) > abs(j) else ("RIGHT" if j > 0 else "LEFT")


with swarmseat.Client() as seat:
    obs = seat.obs()
    while obs["alive"] and obs["status"] in ("waiting", "running"):
        if obs["status"] == "waiting":  # Not all seats have holders yet.
            obs = seat.obs(after=0, wait=1)
        else:
            obs = seat.act(obs["round"], decide(obs), wait=60)["obs"] or seat.obs()
    print(obs["agent"], obs["status"], "score", obs["score"])
