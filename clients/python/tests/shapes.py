"""Comparison of a value with a type of `swarmseat.wire`: fields may neither be missing nor be added."""

import types
from collections.abc import Mapping, Sequence
from typing import Any, Literal, Union, get_args, get_origin

from typing_extensions import NotRequired, Required, get_type_hints, is_typeddict


def fields(shape: Any) -> dict[str, tuple[Any, bool]]:
    """The fields of a TypedDict: their types, and whether they may be absent. `Page[T]` has those of its `T`."""
    origin, arguments = get_origin(shape) or shape, get_args(shape)
    filled: dict[Any, Any] = dict(zip(getattr(origin, "__parameters__", ()), arguments, strict=True))
    found = {}
    for name, hint in get_type_hints(origin, include_extras=True).items():
        absent = name in origin.__optional_keys__
        marked: Any = get_origin(hint)
        bare = get_args(hint)[0] if marked in {NotRequired, Required} else hint
        if get_origin(bare) is list and get_args(bare)[0] in filled:
            bare = list[filled[get_args(bare)[0]]]  # type: ignore[misc] # made here
        found[name] = (bare, absent)
    return found


def is_record(shape: Any) -> bool:
    return bool(is_typeddict(get_origin(shape) or shape))


def differences(value: Any, shape: Any, place: str = "answer") -> list[str]:
    """The places where the value differs from the shape."""
    if shape is Any:
        return []
    if is_record(shape):
        if not isinstance(value, dict):
            return [f"{place}: {value!r} is no object"]
        known = fields(shape)
        wrong = [f"{place}.{name} is not in the type" for name in value.keys() - known.keys()]
        wrong += [
            f"{place}.{name} is missing" for name, (_, absent) in known.items() if not absent and name not in value
        ]
        for name, (hint, _) in known.items():
            if name in value:
                wrong += differences(value[name], hint, f"{place}.{name}")
        return wrong
    origin, arguments = get_origin(shape), get_args(shape)
    if origin in {Union, types.UnionType}:
        tried = [differences(value, choice, place) for choice in arguments]
        return [] if any(not wrong for wrong in tried) else min(tried, key=len)
    if origin is Literal:
        return [] if value in arguments else [f"{place}: {value!r} is none of {arguments}"]
    if origin in {list, Sequence}:
        if not isinstance(value, list):
            return [f"{place}: {value!r} is no list"]
        return [wrong for n, item in enumerate(value) for wrong in differences(item, arguments[0], f"{place}[{n}]")]
    if origin in {dict, Mapping}:
        if not isinstance(value, dict):
            return [f"{place}: {value!r} is no object"]
        return [wrong for key, item in value.items() for wrong in differences(item, arguments[1], f"{place}.{key}")]
    # JSON knows one kind of number; bool is no number there.
    fits = isinstance(value, (int, float)) and not isinstance(value, bool) if shape is float else type(value) is shape
    return [] if fits else [f"{place}: {value!r} is not {shape}"]
