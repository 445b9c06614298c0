"""Facts about the server that schemathesis cannot know: existing episodes, the open round, and that no request
may wait for long. .ci/schemathesis loads this file and sets the variables."""

import os
import random

import requests
import schemathesis

BASE = os.environ["SWARMBENCH_BASE"]
RUNNING = os.environ["SWARMBENCH_RUNNING"]
ENDED = os.environ["SWARMBENCH_ENDED"]
WAITING = os.environ["SWARMBENCH_WAITING"]
RUN = os.environ["SWARMBENCH_RUN"]
ENDED_RUN = os.environ["SWARMBENCH_ENDED_RUN"]
WAIT_S_MAX = 0.05
ACTIONS = ["UP", "DOWN", "LEFT", "RIGHT", "STAY", "SWITCH"]

# The draws follow from the seed of the run, as the cases come in the same order.
dice = random.Random(os.environ.get("SCHEMATHESIS_SEED", "1"))


def is_number(value):
    try:
        return 0 <= float(value) <= 60
    except (TypeError, ValueError):
        return False


def open_round(path, token):
    """Asks the server for the open round, to which an act has to answer."""
    headers = {"Authorization": f"Bearer {token}"}
    seen = requests.get(BASE + path, headers=headers, timeout=10).json()
    seen = seen["observations"][0] if "observations" in seen else seen
    return seen["round"]


@schemathesis.hook
def before_load_schema(context, raw_schema):
    """Replaces schemas of streams: in OpenAPI 3.1 a stream is a text, but schemathesis compares single events."""
    for operations in raw_schema["paths"].values():
        for operation in operations.values():
            for answer in operation.get("responses", {}).values() if isinstance(operation, dict) else ():
                stream = answer.get("content", {}).get("text/event-stream")
                if stream is not None:
                    stream["schema"] = stream["schema"]["contentSchema"]


@schemathesis.hook
def before_call(context, case, kwargs):
    query = case.query
    if isinstance(query, dict) and is_number(query.get("wait")):
        query["wait"] = min(float(query["wait"]), WAIT_S_MAX)
    path, method = case.operation.path, case.method.upper()
    # Half of the ids are those of existing episodes. No case ends an episode that another case needs. A stream of
    # events ends with its episode, so one that runs would never be read to its end: schemathesis also asks for ids
    # that it found in answers.
    if "{id}" in path and case.path_parameters:
        is_stream = path.endswith("/events")
        found = str(case.path_parameters.get("id")).startswith(("ep_", "run_"))
        if dice.random() < 0.5 or (found and (is_stream or method == "DELETE")):
            ids = [] if is_stream else [WAITING] if method == "DELETE" else [WAITING, RUNNING]
            of_runs = [ENDED_RUN] if is_stream else [RUN, ENDED_RUN]
            is_run = path.startswith("/api/v1/runs/")
            case.path_parameters["id"] = dice.choice(of_runs if is_run else [ENDED, *ids])
    # Half of the acts that are objects answer the open round with an action that exists.
    body = case.body
    if path == "/act" and isinstance(body, dict) and dice.random() < 0.5:
        body["round"] = open_round("/obs", os.environ["SWARMBENCH_SEAT"])
        if isinstance(body.get("action"), str) and "response" not in body:
            body["action"] = dice.choice(ACTIONS)
    if path == "/swarm/act" and isinstance(body, dict) and isinstance(body.get("acts"), list):
        for act in body["acts"]:
            if isinstance(act, dict) and dice.random() < 0.7:
                act["episode"] = os.environ["SWARMBENCH_SWARM_EPISODE"]
                act["agent"] = dice.choice(["Agent_0", "Agent_1"])
                act["round"] = open_round("/swarm/obs", os.environ["SWARMBENCH_SWARM"])
                if isinstance(act.get("action"), str) and "response" not in act:
                    act["action"] = dice.choice(ACTIONS)
