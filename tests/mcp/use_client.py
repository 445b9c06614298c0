"""Plays a game through the official Python client of the Model Context Protocol: one seat over HTTP, one over stdio.

Run by .ci/mcp: SWARMBENCH_URL=http://127.0.0.1:8080 SWARMBENCH_BINARY=swarmbench python use_client.py
"""

import asyncio
import json
import os
import re
import urllib.request
from typing import Any

import httpx2
from mcp import Client
from mcp.client.stdio import StdioServerParameters
from mcp.client.streamable_http import streamable_http_client

URL = os.environ["SWARMBENCH_URL"]
BINARY = os.environ["SWARMBENCH_BINARY"]
ROUNDS = 5


def ask(path: str, body: object = None, token: str | None = None) -> Any:
    """Asks the server without the protocol."""
    data = None if body is None else json.dumps(body).encode()
    headers = {"Content-Type": "application/json"} | ({"Authorization": f"Bearer {token}"} if token else {})
    with urllib.request.urlopen(urllib.request.Request(URL + path, data, headers)) as answer:
        return json.load(answer)


def texts(result: Any) -> list[str]:
    """What a model reads."""
    return [block.text for block in result.content]


async def play(client: Client) -> None:
    """Plays a seat to the end as a model would: by what the texts say."""
    said = texts(await client.call_tool("look", {"wait_s": 45}))
    while not said[-1].startswith("The game is over"):
        found = re.search(r"Round (\d+) is open", said[-1])
        if found is None:
            assert "call `look`" in said[-1], said
            result = await client.call_tool("look", {"wait_s": 45})
        else:
            assert "ACTION" in said[-2], said
            act = {"round": int(found[1]), "action": "SWITCH", "message": "together"}
            result = await client.call_tool("act", act)
        assert not result.is_error, result
        said = texts(result)


async def check(client: Client, token: str) -> None:
    """What there is beside the game."""
    assert client.server_info is not None
    assert client.server_info.name == "swarmbench", client.server_info
    tools = {tool.name: tool for tool in (await client.list_tools()).tools}
    assert list(tools) == ["look", "act"], tools
    assert tools["act"].annotations.idempotent_hint is True
    assert tools["look"].annotations.read_only_hint is True
    rules = await client.read_resource("swarmbench://rules")
    assert "# The rules" in rules.contents[0].text, rules.contents[0].text[:200]
    prompt = await client.get_prompt("play")
    assert "`look`" in prompt.messages[0].content.text
    seen = await client.call_tool("look")
    observation = dict(seen.structured_content)
    assert observation.pop("next") == texts(seen)[-1]
    assert observation == ask("/obs?prompt=true", token=token)
    for arguments, expected in [
        ({"round": 0, "action": "FLY"}, "must be one of UP, DOWN"),
        ({"round": 99, "action": "UP"}, "not open yet"),
        ({"round": "first"}, "round must be a whole number"),
    ]:
        refused = await client.call_tool("act", arguments)
        assert refused.is_error, refused
        assert expected in texts(refused)[0], texts(refused)


async def over_http(token: str | None, mode: str) -> None:
    headers = {"Authorization": f"Bearer {token}"} if token else {}
    async with httpx2.AsyncClient(headers=headers, timeout=60) as http:
        async with Client(streamable_http_client(f"{URL}/mcp", http_client=http), mode=mode) as client:
            await use(client, token)
            print("HTTP", mode, client.protocol_version)


async def over_stdio(token: str | None, mode: str) -> None:
    env = {"SWARMBENCH_TOKEN": token} if token else {}
    command = StdioServerParameters(command=BINARY, args=["mcp", "--server", URL], env=env)
    async with Client(command, mode=mode) as client:
        await use(client, token)
        print("stdio", mode, client.protocol_version)


async def use(client: Client, token: str | None) -> None:
    if token is not None:
        await check(client, token)
        await play(client)
        return
    refused = await client.call_tool("look")
    assert refused.is_error, refused
    assert "seat token" in texts(refused)[0], texts(refused)


async def main() -> None:
    for mode in ["auto", "legacy"]:
        game = {"task": "Synchronization", "num_agents": 2, "max_round": ROUNDS, "model": "mcp"}
        created = ask("/api/v1/episodes", game)
        one, other = (seat["token"] for seat in created["seats"])
        await asyncio.gather(over_http(one, mode), over_stdio(other, mode))
        result = ask(f"/api/v1/episodes/{created['id']}")["result"]
        assert result["rounds"] == ROUNDS, result
        await asyncio.gather(over_http(None, mode), over_stdio(None, mode))


asyncio.run(main())
