"""Methods that make requests, for both clients."""

import uuid
from collections.abc import Callable, Coroutine
from functools import update_wrapper
from types import MethodType
from typing import TYPE_CHECKING, Any, Concatenate, Generic, ParamSpec, TypeVar, cast, overload

from ._compat import Self
from .exchange import Call

if TYPE_CHECKING:
    from .client import AsyncClient, Client

P = ParamSpec("P")
T = TypeVar("T")


class Operation(Generic[P, T]):
    """A method that makes a request. On a `Client` it returns the answer, on an `AsyncClient` it is awaited."""

    def __init__(self, build: Callable[Concatenate[Any, P], Call[T]]) -> None:
        self._build = build
        update_wrapper(cast("Callable[..., Any]", self), build)

    def __call__(self, client: "Client | AsyncClient", *args: P.args, **kwargs: P.kwargs) -> Any:
        """Calls the method on the client that is its first argument, as with any function of a class."""
        return client.send(self._build(client, *args, **kwargs))

    @overload
    def __get__(self, instance: None, owner: type) -> Self: ...
    @overload
    def __get__(self, instance: "Client", owner: type) -> Callable[P, T]: ...
    @overload
    def __get__(self, instance: "AsyncClient", owner: type) -> Callable[P, Coroutine[Any, Any, T]]: ...
    def __get__(self, instance: Any, owner: type) -> Any:
        if instance is None:
            return self

        return MethodType(self, instance)


def once(key: str | None) -> dict[str, str]:
    """The `Idempotency-Key` of a creation: a retry must not create a second one."""
    return {"idempotency-key": key or uuid.uuid4().hex}
