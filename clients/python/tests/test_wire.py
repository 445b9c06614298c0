"""The types of `swarmseat.wire` are those of the OpenAPI document: they cannot drift from the wire."""

import json
import types
from collections.abc import Mapping, Sequence
from typing import Any, Literal, Union, get_args, get_origin

import pytest
from conftest import ROOT
from shapes import fields, is_record

from swarmseat import wire

DOCUMENT = json.loads((ROOT / "openapi" / "openapi.json").read_text())
SCHEMAS: dict[str, Any] = DOCUMENT["components"]["schemas"]

# Types that have another name in the document, or none.
PAGES = {
    "EpisodeList": wire.Page[wire.EpisodeSummary],
    "RunList": wire.Page[wire.RunSummary],
    "SuiteList": wire.Page[wire.SuiteView],
    "CrossPlay": wire.Page[wire.CrossPlayPair],
}
QUERIES = {"/api/v1/leaderboard": wire.LeaderboardQuery, "/api/v1/cross-play": wire.CrossPlayQuery}
# Bodies of requests. All other types are answers.
SENT = {"EpisodeRequest", "ClaimRequest", "RunRequest", "OwnSuite", "OwnSettings", "ActRequest", "SwarmActRequest"}
SENT |= {"SwarmAct", "Usage", "ForkRequest"}
RECORDS = {
    name: shape
    for name, shape in vars(wire).items()
    if is_record(shape) and name not in {"Page", "LeaderboardQuery", "CrossPlayQuery", "TypedDict"}
} | PAGES


def resolved(schema: dict[str, Any]) -> dict[str, Any]:
    """A schema without references; the parts of `allOf` are one."""
    if "$ref" in schema:
        return resolved(SCHEMAS[schema["$ref"].rsplit("/", 1)[1]])
    if "allOf" in schema:
        parts = [resolved(part) for part in schema["allOf"]]
        properties = {name: part for one in parts for name, part in one["properties"].items()}
        required = [name for one in parts for name in one.get("required", [])]
        return {"type": "object", "properties": properties, "required": required}
    return schema


def kinds_of_schema(schema: dict[str, Any]) -> set[str]:
    """The allowed kinds of a value: names of types of JSON, and of records."""
    if "$ref" in schema:
        name = schema["$ref"].rsplit("/", 1)[1]
        if resolved(SCHEMAS[name]).get("type") == "object":
            return {name}
        return kinds_of_schema(SCHEMAS[name])
    if "oneOf" in schema:
        return set().union(*(kinds_of_schema(choice) for choice in schema["oneOf"]))
    kinds = schema.get("type", "any")
    return set(kinds) if isinstance(kinds, list) else {kinds}


def kinds_of_type(shape: Any) -> set[str]:
    if shape is Any:
        return {"any"}
    if is_record(shape):
        return {shape.__name__}
    origin, arguments = get_origin(shape), get_args(shape)
    if origin in {Union, types.UnionType}:
        return set().union(*(kinds_of_type(choice) for choice in arguments))
    if origin is Literal:
        return {"string"}
    if origin in {list, Sequence}:
        return {"array"}
    if origin in {dict, Mapping}:
        return {"object"}
    return {{str: "string", int: "integer", float: "number", bool: "boolean", type(None): "null"}[shape]}


@pytest.mark.parametrize("name", RECORDS)
def test_a_type_has_the_fields_of_the_document(name: str) -> None:
    schema, known = resolved(SCHEMAS[name]), fields(RECORDS[name])
    assert known.keys() == schema["properties"].keys()
    required = set(schema.get("required", []))
    is_sent = name in SENT
    for field, (shape, may_be_absent) in known.items():
        told, ours = kinds_of_schema(schema["properties"][field]), kinds_of_type(shape)
        # A required field that is null is refused in the server's own words, so the document lets it be null.
        assert ours == told or (is_sent and field in required and ours | {"null"} == told), field
        # The document only says which fields of answers are never null; test_client.py looks at real answers.
        assert may_be_absent == (field not in required) if is_sent else not (may_be_absent and field in required), field
        if told >= {"array"}:
            lists = [choice for choice in (shape, *get_args(shape)) if get_origin(choice) in {list, Sequence}]
            assert kinds_of_type(get_args(lists[0])[0]) == kinds_of_items(schema["properties"][field]["items"]), field


def kinds_of_items(items: dict[str, Any]) -> set[str]:
    # The union of receipt and problem has a name of its own in the document.
    return (
        kinds_of_schema(resolved(items)) if "$ref" in items and "oneOf" in resolved(items) else kinds_of_schema(items)
    )


@pytest.mark.parametrize("path", QUERIES)
def test_a_query_has_the_parameters_of_the_document(path: str) -> None:
    parameters = {parameter["name"] for parameter in DOCUMENT["paths"][path]["get"]["parameters"]}
    assert fields(QUERIES[path]).keys() == parameters - {"format"}


def test_failures_are_those_of_the_server() -> None:
    assert list(get_args(wire.Failure)) == SCHEMAS["Failure"]["enum"]


def test_names_of_states_are_those_of_the_server() -> None:
    assert list(get_args(wire.StatusName)) == SCHEMAS["StatusName"]["enum"]


def test_all_that_the_client_returns_is_compared() -> None:
    # A parameter that is missing here would be a name that the document does not know.
    assert set(RECORDS) <= SCHEMAS.keys()
    assert len(RECORDS) > 45
