"""A stand-in for the file of this name in the public toolkit: its structure, other words."""


class Task:
    def __init__(self, seed=42):
        self.score = 0

    def task_obs(self, agent):
        return {}


class Transport(Task):
    def desc(self):
        return "Push {B}.\nThen go."


class Flocking(Task):
    shape_desc = ""

    def desc(self):
        return f"Stand like this:\n{self.shape_desc}"


class Pursuit(Task):
    def task_obs(self, agent):
        return {"score": self.score}

    def desc(self):
        return "Catch P:\n.,A,.\n  {{ not a tag }} {% nor this %}"


class Synchronization(Task):
    agent_state = {}

    def task_obs(self, agent):
        return {"light_on": self.agent_state[agent.name]}

    def desc(self):
        return "Use SWITCH."


class Foraging(Task):
    food_state = {}

    def task_obs(self, agent):
        return {"carrying_food": self.food_state[agent.name]}

    def desc(self):
        return "Carry F to N.\n"
