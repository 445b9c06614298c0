"""A stand-in for a language model, behind an endpoint of the usual form. The answer depends only on the last prompt."""

import json
import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any


def reply(prompt: str) -> str:
    """Switches the light in even rounds. Otherwise agents walk, talk, and sometimes give a useless answer."""
    agent = int(re.search(r"You are Agent_(\d+)", prompt)[1])  # type: ignore[index]
    round = int(re.search(r"Round: (\d+)", prompt)[1])  # type: ignore[index]
    return ("ACTION: UP", f"ACTION: LEFT\nMSG: round {round}", "I do not know.")[(agent + round) % 3]


@contextmanager
def served() -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """The address of the endpoint, and the requests that it has answered."""
    requests: list[dict[str, Any]] = []

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            request = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
            requests.append(request)
            message = {"role": "assistant", "content": reply(request["messages"][-1]["content"])}
            answer = {
                "id": "1", "object": "chat.completion", "created": 0, "model": request["model"],
                "choices": [{"index": 0, "message": message, "finish_reason": "stop"}],
                "usage": {"prompt_tokens": 1, "completion_tokens": 1, "total_tokens": 2},
            }  # fmt: skip
            body = json.dumps(answer).encode()
            self.send_response(200)
            self.send_header("Content-Type", "application/json")
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *_: object) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.server_address[1]}/v1", requests
    finally:
        server.shutdown()
