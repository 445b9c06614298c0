"""The resources of an environment, which it has to release: connections, its episode, and a server of its own."""

import os
import warnings
from contextlib import suppress

from .checks import shown
from .client import Client
from .errors import ApiError, ArgumentError, ConnectionFailedError
from .exchange import Retry
from .server import Server
from .wire import CreatedEpisode

ENDING_S_MAX = 2.0
"""The maximum time of one attempt to end an episode. If the server does not answer, the episode ends there by itself,
after `idle_timeout_s` without an act."""

ENDING_RETRY = Retry(times=2, patience_s=ENDING_S_MAX)


class Resources:
    """Opens the resources, and closes them once.

    Args:
        server: The address of a server, a `Server`, a `Client`, or None for a server of its own.
        token: A key for the address.
    """

    def __init__(self, server: str | Server | Client | None, token: str | None) -> None:
        self._process = os.getpid()
        self._given = server
        self._own_server: Server | None = None
        self._ending: tuple[str, str] | None = None
        self.swarm: Client | None = None
        if isinstance(server, Client):
            self.client = server
        elif isinstance(server, Server):
            self.client = server.client()
        elif server is None:
            self._own_server = Server().start()
            self.client = self._own_server.client()
        else:
            self.client = Client(server, token)

    @property
    def server(self) -> str | Server | Client | None:
        """The server, on which another environment can play, too."""
        return self._own_server or self._given

    def begin(self, created: CreatedEpisode) -> None:
        """Takes the tokens of an episode."""
        self.swarm = self.client.with_token(created["swarm_token"])
        self._ending = (created["id"], created["swarm_token"])

    def ended(self) -> None:
        """Notes that the episode is at its end."""
        self._ending = None

    def abort(self) -> None:
        """Aborts the episode, if it is not at its end."""
        if self.swarm is not None:
            self._abort(self.swarm)
        self.swarm = None

    def close(self) -> None:
        """Ends the episode, closes the connections, and stops the server that is its own."""
        if isinstance(self._given, Server) and not self._given.is_running:
            # The server is gone, and with it its episodes.
            self.ended()
        if self._own_server is not None:
            self.ended()
        try:
            self.abort()
        finally:
            self._release()

    def finalize(self, name: str) -> None:
        """`close` for an environment that was not closed, when it is collected or the program ends.

        This method raises nothing, and uses no connections over which another request may be under way.
        """
        if os.getpid() != self._process:
            # A forked process has a copy, and must not end its parent's episode.
            return
        if self._ending is None and isinstance(self._given, Client):
            return
        with suppress(Exception):
            if self._ending is not None and self._own_server is None:
                with Client(self.client.server, self._ending[1]) as ending:
                    self._abort(ending)
        with suppress(Exception):
            self._release()
        message = f"unclosed environment {name}: call close(), or use it in a `with` block"
        warnings.warn(message, ResourceWarning, stacklevel=2, source=self)

    def _abort(self, swarm: Client) -> None:
        ending, self._ending = self._ending, None
        if ending is None:
            return
        swarm.retry, swarm.timeout = ENDING_RETRY, min(swarm.timeout, ENDING_S_MAX)
        try:
            swarm.abort_episode(ending[0])
        except ConnectionFailedError:
            # Nobody is left to continue the episode.
            pass
        except ApiError as error:
            # Another client ended the episode, or it is gone with its database.
            if error.code not in {"episode_over", "not_found", "unauthorized"}:
                raise

    def _release(self) -> None:
        if not isinstance(self._given, Client):
            self.client.close()
        if self._own_server is not None:
            self._own_server.stop()
            self._own_server = None


def check_server(server: object, token: object) -> None:
    """Checks the arguments that name an environment's server."""
    if server is not None and not isinstance(server, str | Server | Client):
        raise ArgumentError(f"server is an address, a Server, a Client or None, and not {shown(server)}")
    if token is not None and not isinstance(server, str):
        raise ArgumentError("token is the key for a server that is given by its address; give that as `server`, too")
    if isinstance(server, str):
        # A wrong address or token is an error now, not at the first reset.
        Client(server, token if isinstance(token, str) else None).close()
