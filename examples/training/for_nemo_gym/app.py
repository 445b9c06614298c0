"""A resources server for NeMo Gym: copy this folder to its `resources_servers/swarmbench`.

    python app.py --rows 20 > data/example.jsonl     # rows: a task, a seed, a mode, settings

The server speaks NeMo Gym's Gymnasium protocol. NeMo Gym's own adapter for OpenEnv drops the first observation and the
seed of a row; this server has both.
"""

import argparse
import json
from typing import Any

from swarmseat import TextEpisode, Turn

try:
    from nemo_gym.openai_utils import NeMoGymResponse
    from resources_servers.gymnasium import GymnasiumServer, extract_text
except ModuleNotFoundError:
    # Printing rows does not need NeMo Gym.
    GymnasiumServer, extract_text, NeMoGymResponse = object, None, Any

SESSIONS_MAX = 4_096
"""The maximum number of open episodes: 24 kB each at the start, 160 kB after 100 rounds of agents that talk."""


class SwarmGym(GymnasiumServer):
    """Episodes by session.

    A row names `task` and `seed`, and may name `mode` (one_seat, turns or joint) and `settings`.
    """

    def checkpoint_state_enabled(self) -> bool:
        """Whether sessions can be saved: no, as an episode is played again from its row."""
        return False

    async def reset(self, metadata: dict[str, Any], session_id: str | None = None) -> tuple[str | None, dict[str, Any]]:
        """Begins the episode of a row."""
        await self.close_session(session_id)
        if len(self.session_state) >= SESSIONS_MAX:
            raise RuntimeError(f"{SESSIONS_MAX} episodes are played already (SESSIONS_MAX): end some first")
        mode = metadata.get("mode", "one_seat")
        episode = TextEpisode(metadata.get("task", "Foraging"), mode, **metadata.get("settings", {}))
        self.session_state[session_id] = episode
        turn = episode.reset(metadata.get("seed"))
        return turn.prompt, self._info(episode, turn)

    async def step(
        self, action: NeMoGymResponse, metadata: dict[str, Any], session_id: str | None = None
    ) -> tuple[str | None, float, bool, bool, dict[str, Any]]:
        """Takes an answer. The rewards of an episode add up to a share of a full score."""
        del metadata  # The row is that of the reset.
        episode = self.session_state.get(session_id)
        if episode is None:
            raise RuntimeError("this session has no episode: reset it first")
        turn = episode.step(extract_text(action))
        return turn.prompt or None, turn.gain, turn.done, False, self._info(episode, turn)

    async def close_session(self, session_id: str | None) -> None:
        """Forgets an episode."""
        episode = self.session_state.pop(session_id, None)
        if episode is not None:
            episode.close()

    def _info(self, episode: TextEpisode, turn: Turn) -> dict[str, Any]:
        return {
            "task": episode.world.task, "seed": episode.seed, "round": turn.round, "score": turn.score,
            "invalid": list(turn.invalid.values()),
        }  # fmt: skip


def rows(count: int) -> list[dict[str, Any]]:
    """Rows for training: all tasks in turn, each with a layout of its own."""
    tasks = ("Transport", "Pursuit", "Synchronization", "Foraging", "Flocking")
    return [
        {
            "responses_create_params": {"input": []}, "task": tasks[number % 5], "seed": 1_000_000 + number // 5,
            "mode": "one_seat", "settings": {"max_round": 20},
        }
        for number in range(count)
    ]  # fmt: skip


def main() -> None:
    """Prints rows, or serves."""
    parser = argparse.ArgumentParser(description="A resources server for NeMo Gym.")
    parser.add_argument("--rows", type=int, help="print this many rows of data and exit")
    told, _ = parser.parse_known_args()
    if told.rows is not None:
        for row in rows(told.rows):
            print(json.dumps(row))
        return
    SwarmGym.run_webserver()


if __name__ == "__main__":
    main()
