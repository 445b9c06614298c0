"""Writes `swarmseat/wire.py` and `swarmseat/calls.py`: `python clients/python/generate.py`.

Both follow from openapi/openapi.json and from `generate.toml`, which has what the document does not say. With
`--check` nothing is written, and the files must be what would be written.
"""

import json
import re
import subprocess
import sys
import textwrap
import tomllib
from collections.abc import Iterable, Iterator
from keyword import iskeyword
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
WIDTH = 120
DOCUMENT = json.loads((HERE.parents[1] / "openapi" / "openapi.json").read_text())
SCHEMAS: dict[str, Any] = DOCUMENT["components"]["schemas"]
OPERATIONS: dict[str, tuple[str, str, dict[str, Any]]] = {
    operation["operationId"]: (verb.upper(), path, operation)
    for path, verbs in DOCUMENT["paths"].items()
    for verb, operation in verbs.items()
}
TABLES = tomllib.loads((HERE / "generate.toml").read_text())
HEADS, CHOICES, LEFT_OUT, METHODS = (TABLES[name] for name in ("heads", "choices", "left_out", "methods"))
KINDS = {"string": "str", "integer": "int", "number": "float", "boolean": "bool", "null": "None"}


def references(part: Any) -> Iterator[str]:
    """The names of the schemas to which a part of the document refers."""
    if isinstance(part, dict) and "$ref" in part:
        yield part["$ref"].rsplit("/", 1)[1]
    for one in part.values() if isinstance(part, dict) else part if isinstance(part, list) else ():
        yield from references(one)


def with_parts(names: Iterable[str]) -> dict[str, None]:
    """The schemas and all to which they refer, each after its parts."""
    found: dict[str, None] = {}
    for name in names:
        if name not in found:
            found |= with_parts(references(SCHEMAS[name])) | {name: None}
    return found


SENT = with_parts(name for *_, operation in OPERATIONS.values() for name in references(operation.get("requestBody")))


def shape(schema: dict[str, Any], is_sent: bool) -> str:
    """The type of a value. A request takes any sequence and any mapping."""
    if "$ref" in schema:
        return next(references(schema))
    if "oneOf" in schema:
        return " | ".join(shape(choice, is_sent) for choice in schema["oneOf"])
    if "enum" in schema:
        return f"Literal{json.dumps(schema['enum'])}"
    kinds, shapes = schema.get("type", []), []
    for kind in [kinds] if isinstance(kinds, str) else kinds:
        if kind == "array":
            shapes.append(f"{'Sequence' if is_sent else 'list'}[{shape(schema['items'], is_sent)}]")
        elif kind == "object":
            values = shape(schema.get("additionalProperties", {}), is_sent)
            shapes.append(f"{'Mapping' if is_sent else 'dict'}[str, {values}]")
        else:
            shapes.append(KINDS[kind])
    return " | ".join(shapes) or "Any"


def field_shape(record: str, name: str, schema: dict[str, Any], is_required: bool) -> str:
    """The type of a record's field."""
    is_sent = record in SENT
    made = shape(schema, is_sent)
    if (is_sent and name in CHOICES) or (name, made) == ("task", "str"):
        made = CHOICES[name] + (" | None" if made.endswith(" | None") else "")
    if not is_sent:
        return f"NotRequired[{made}]" if name in LEFT_OUT.get(record, []) else made
    # The document lets a required field be null, as the server refuses null in its own words.
    return made.removesuffix(" | None") if is_required else f"NotRequired[{made}]"


def docstring(text: str, indent: int = 0, arguments: dict[str, str] | None = None) -> str:
    """A docstring in lines of at most `WIDTH` characters."""
    wide = WIDTH - indent - len('"""') * 2
    parts = [textwrap.fill(part, wide, break_on_hyphens=False) for part in text.split("\n\n")]
    if arguments:
        hanging = textwrap.TextWrapper(wide, "    ", " " * 8, break_on_hyphens=False)
        parts.append("\n".join(["Args:", *(hanging.fill(f"{name}: {text}") for name, text in arguments.items())]))
    body = "\n\n".join(parts)
    end = "\n" if "\n" in body else ""
    return textwrap.indent(f'"""{body}{end}"""\n', " " * indent)


def record(name: str, bases: str, about: str, fields: dict[str, tuple[str, str]]) -> str:
    """A TypedDict with these fields, each with its type and description."""
    if any(map(iskeyword, fields)):
        comment = textwrap.TextWrapper(WIDTH - 8, "# ", "# ")
        keys = "".join(f"{comment.fill(text)}\n{key!r}: {made},\n" for key, (made, text) in fields.items())
        return f'{name} = TypedDict("{name}", {{\n{keys}}})\n{docstring(about)}'
    lines = [f"    {key}: {made}\n{docstring(text, 4) if text else ''}" for key, (made, text) in fields.items()]
    return f"class {name}({bases}):\n{docstring(about, 4)}\n{''.join(lines)}"


def schema_type(name: str) -> str:
    """The definition of a schema's type."""
    parts, about, fields = SCHEMAS[name].get("allOf", [SCHEMAS[name]]), SCHEMAS[name]["description"], {}
    for part in parts:
        for key, one in part.get("properties", {}).items():
            text = next((side["description"] for side in [one, *one.get("oneOf", [])] if "description" in side), "")
            fields[key] = (field_shape(name, key, one, key in part.get("required", [])), text)
    if fields.keys() == {"items", "next_cursor"}:
        return f"{name}: TypeAlias = Page{fields['items'][0].removeprefix('list')}\n{docstring(about)}"
    bases = ", ".join(shape(part, is_sent=False) for part in parts if "$ref" in part)
    if fields or len(parts) > 1:
        return record(name, bases or "TypedDict", about, fields)
    return f"{name}: TypeAlias = {shape(SCHEMAS[name], name in SENT)}\n{docstring(about)}"


def parameters(operation: str, place: str) -> dict[str, tuple[str, str]]:
    """The parameters of an operation in a path, a query or the headers, with their types and descriptions."""
    return {
        one["name"]: (
            CHOICES.get(f"{operation}.{one['name']}") or CHOICES.get(one["name"]) or shape(one["schema"], is_sent=True),
            one["description"],
        )
        for one in OPERATIONS[operation][2].get("parameters", [])
        if one["in"] == place
    }


def query_type(operation: str) -> str:
    """The name of the type of an operation's query, such as `CrossPlayQuery`."""
    return operation.split("_", 1)[1].title().replace("_", "") + "Query"


def wire() -> str:
    """The module of the types."""
    defined = {name: schema_type(name) for name in with_parts(SCHEMAS)}
    for operation, method in METHODS.items():
        query = parameters(operation, "query")
        if query.pop("format", None):
            fields = {key: (f"NotRequired[{made}]", text) for key, (made, text) in query.items()}
            name = query_type(operation)
            defined[name] = record(name, "TypedDict", f"Query of `{method}` and `{method}_csv`.", fields)
    return "\n\n".join([HEADS["wire"], *defined.values()])


def call(name: str, method: str, form: str | None) -> str:
    """The method of an operation, for the answer as JSON, CSV or bytes."""
    verb, path, operation = OPERATIONS[name]
    ids, query = parameters(name, "path"), parameters(name, "query")
    about = {key: text for key, (_, text) in ids.items()}
    takes = ["self", *(f"{key}: {made}" for key, (made, _) in ids.items())]
    sends = [repr(verb), repr(re.sub(r"{\w+}", "{}", path))]
    sends += [key if made == "str" else f"str({key})" for key, (made, _) in ids.items()]
    if form:
        takes.append(f"**query: Unpack[wire.{query_type(name)}]")
        sends.append(f'query={{**query, "format": "{form}"}}')
        about["**query"] = f"Fields of `wire.{query_type(name)}`."
    elif query:
        own = {key: f"{key}_" if iskeyword(key) else key for key in query}
        shapes = {own[key]: f"wire.{made}" if made in CHOICES.values() else made for key, (made, _) in query.items()}
        takes += ["*", *(f"{key}: {made} | None = None" for key, made in shapes.items())]
        sends.append(f"query={{{', '.join(f'{key!r}: {own[key]}' for key in query)}}}")
        about |= {own[key]: text for key, (_, text) in query.items()}
    for body in references(operation.get("requestBody")):
        takes += ["*", "idempotency_key: str | None = None", f"**settings: Unpack[wire.{body}]"]
        sends += ["body=settings", "headers=once(idempotency_key)"]
        about["idempotency_key"] = parameters(name, "header")["Idempotency-Key"][1]
        about["**settings"] = f"Fields of `wire.{body}`."
    content = next(answer for status, answer in operation["responses"].items() if status < "300")["content"]
    is_json = "application/json" in content and form != "csv"
    gives = f"wire.{next(references(content['application/json']))}" if is_json else "str" if form else "bytes"
    reads = "" if is_json else ", read=bytes.decode" if form else ", read=bytes"
    text = docstring("\n\n".join(operation[key] for key in ("summary", "description") if key in operation), 8, about)
    head = f"    @Operation\n    def {method}({', '.join(takes)}) -> Call[{gives}]:"
    return f"{head}\n{text}        return call({', '.join(sends)}{reads})\n"


def calls() -> str:
    """The module of the calls."""
    methods = []
    for operation, method in METHODS.items():
        forms = {"": "json", "_csv": "csv"} if "format" in parameters(operation, "query") else {"": None}
        methods += [call(operation, method + ending, form) for ending, form in forms.items()]
    return "\n".join([HEADS["calls"], *methods])


for made in (wire, calls):
    file = HERE / "src" / "swarmseat" / f"{made.__name__}.py"
    ruff = [sys.executable, "-m", "ruff", "format", "--no-cache", "--stdin-filename", str(file), "-"]
    formatted = subprocess.run(ruff, input=made(), cwd=HERE, check=True, stdout=subprocess.PIPE, text=True).stdout
    if "--check" not in sys.argv:
        file.write_text(formatted)
    elif file.read_text() != formatted:
        sys.exit(f"{file} is not what generate.py writes")
