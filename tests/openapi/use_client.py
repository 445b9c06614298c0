"""Plays a game through the client that openapi-python-client makes, and reads one answer of every kind of body.

Run by .ci/openapi: SWARMBENCH_URL=http://127.0.0.1:8080 python use_client.py
"""

import io
import os
import zipfile

import pyarrow.parquet
from swarmbench_client import AuthenticatedClient, Client
from swarmbench_client.api.agent import get_obs, post_act
from swarmbench_client.api.boards import show_leaderboard
from swarmbench_client.api.data import download_export
from swarmbench_client.api.episodes import create_episode, read_journal, show_episode, stream_events
from swarmbench_client.models import ActRequest, EpisodeRequest, Problem
from swarmbench_client.types import File

url = os.environ["SWARMBENCH_URL"]
anyone = Client(base_url=url)

settings = EpisodeRequest(task="Synchronization", num_agents=1, max_round=5, seed=27, model="generated")
created = create_episode.sync(client=anyone, body=settings)
seat = AuthenticatedClient(base_url=url, token=created.seats[0].token)
seen = get_obs.sync(client=seat)
while seen.status == "running":
    post_act.sync(client=seat, body=ActRequest(round_=seen.round_, action="SWITCH"))
    seen = get_obs.sync(client=seat)
assert show_episode.sync(created.id, client=anyone).result.score == 5.0, seen

refused = post_act.sync(client=seat, body=ActRequest(round_=4, action="UP"))
assert isinstance(refused, Problem), refused
assert refused.code == "already_acted", refused


def bytes_of(file: File | None) -> bytes:
    assert isinstance(file, File), file
    return file.payload.read()


table = pyarrow.parquet.read_table(io.BytesIO(bytes_of(download_export.sync("acts.parquet", client=anyone))))
assert table.num_rows == 5, table
names = zipfile.ZipFile(io.BytesIO(bytes_of(download_export.sync("dataset.zip", client=anyone)))).namelist()
assert "meta_log.json" in names, names
assert bytes_of(download_export.sync("acts.jsonl", client=anyone)).count(b"\n") == 5
assert bytes_of(read_journal.sync(created.id, client=anyone)).count(b"\n") == 7
assert stream_events.sync(created.id, client=anyone).count("event: round") == 5

assert any(row.reference for row in show_leaderboard.sync(client=anyone).items)
# What docs/play/other-languages.md says of CSV.
board = anyone.get_httpx_client().get("/api/v1/leaderboard", params={"format": "csv"}).text
assert board.startswith("suite,") and board.count("\n") > 10, board
print("a game, a refusal, Parquet, ZIP, JSON Lines, events, JSON and CSV")
