"""What the messages of each channel look like, as an MCAP file says it to programs that do not know them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import msgspec

from sattrack.mount.xerxes.datagrams import COMMAND_FIELDS, STATUS_FIELDS
from sattrack.recording.format import (
    COMMAND,
    FAILURE,
    OPERATOR,
    REPEAT,
    RUN,
    STATUS,
    SUMMARY,
    VIEW,
    RunHeader,
)
from sattrack.recording.format import Failure as FailureMessage
from sattrack.views.messages import Message
from sattrack.views.run import Summary, TrackView

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sattrack.mount.xerxes.datagrams import Field

JSON_SCHEMA, LAYOUT = "jsonschema", "layout.csv"
"""Encodings of schemas: the well-known one, and our own, a line a field of a datagram."""


class ChannelSchema(NamedTuple):
    """A schema's name, its encoding and its text."""

    name: str
    encoding: str
    text: bytes


def channel_schemas() -> dict[str, ChannelSchema]:
    """Return the schema of each topic.

    References are written out and null is left out of JSON types, as not all readers know them: a field that
    has a default may be null.
    """
    status = ChannelSchema("xerxes.Status", LAYOUT, _layout(STATUS_FIELDS))
    command = ChannelSchema("xerxes.Command", LAYOUT, _layout(COMMAND_FIELDS))
    kinds = {RUN: RunHeader, VIEW: TrackView, SUMMARY: Summary, FAILURE: FailureMessage}
    found = {topic: _json(f"sattrack.{kind.__name__}", kind) for topic, kind in kinds.items()}
    found[OPERATOR] = _json("sattrack.Message", Message)
    return found | {STATUS: status, COMMAND: command, REPEAT: command}


def _layout(fields: Sequence[Field]) -> bytes:
    """Return a datagram's fields, little-endian: offset, type as `struct` writes it, name with its unit."""
    lines = [f"{one.offset},{one.kind.value.replace('S', 's')},{one.name}" for one in fields]
    return "\n".join(["offset,type,name", *lines, ""]).encode()


def _json(name: str, kind: Any) -> ChannelSchema:
    (schema,), parts = msgspec.json.schema_components([kind])
    # Of a union of messages, the fields of any of them.
    every = [_plain(one, parts) for one in schema.get("anyOf", [schema])]
    fields = {key: value for one in every for key, value in one["properties"].items()}
    told = {"title": name, "type": "object", "properties": fields}
    return ChannelSchema(name, JSON_SCHEMA, msgspec.json.encode(told))


def _plain(schema: dict[str, Any], parts: dict[str, Any]) -> dict[str, Any]:
    """Return a schema without references, alternatives of null, defaults and what must be there."""
    if "$ref" in schema:
        return _plain(parts[schema["$ref"].rsplit("/", 1)[1]], parts)
    if "anyOf" in schema:
        others = [one for one in schema["anyOf"] if one.get("type") != "null"]
        return _plain(others[0], parts) if others else {"type": "null"}
    if "enum" in schema:
        return {"type": "string"}
    if schema.get("type") == "object" and "properties" in schema:
        fields = {key: _plain(value, parts) for key, value in schema["properties"].items()}
        return {"type": "object", "properties": fields}
    if schema.get("type") == "array":
        items = schema.get("items") or next(iter(schema.get("prefixItems", ())), None)
        return {"type": "array", "items": _plain(items, parts) if items else {"type": "object"}}
    return {"type": schema.get("type", "object")}
