"""JSON Schema documents of our messages, in the part of JSON Schema that viewers read.

Foxglove's and Lichtblick's parser takes one ``type`` for each field, objects, and arrays of
plain values or of objects: no ``$ref``, ``anyOf``, ``prefixItems``, arrays of arrays or ``null``.
A schema outside of that makes the whole topic vanish from their lists. What it cannot say truly
(a field that may be null, a list of boxes) is left undeclared, which JSON Schema allows, and named
in ``$comment``: every payload still holds to its schema.
"""

from __future__ import annotations

from typing import Any

import msgspec

_PLAIN = ("boolean", "integer", "number", "string")
_KEPT = ("title", "description", "required", "minimum", "maximum", "default")
_UNDECLARED = "there as well, outside of what viewers' schemas can say: "


def document(kind: type[msgspec.Struct]) -> dict[str, Any]:
    """The schema of a message, nested messages written out in place. Ours are not recursive."""
    whole = msgspec.json.schema(kind)
    definitions = whole.pop("$defs", {})
    made = _object(_resolved(whole, definitions), definitions)
    assert made["type"] == "object"
    return made


def _resolved(node: dict[str, Any], definitions: dict[str, Any]) -> dict[str, Any]:
    while "$ref" in node:
        node = definitions[node["$ref"].rsplit("/", 1)[1]]
    return node


def _object(node: dict[str, Any], definitions: dict[str, Any]) -> dict[str, Any]:
    properties, undeclared = {}, []
    for name, field in node.get("properties", {}).items():
        said = _field(_resolved(field, definitions), definitions)
        if said is None:
            undeclared.append(name)
        else:
            properties[name] = said
    out = {key: node[key] for key in _KEPT if key in node} | {"type": "object"}
    if isinstance(node.get("additionalProperties"), dict):
        out["additionalProperties"] = node["additionalProperties"]
    # There also where it is empty: parsers go through it without asking.
    out["properties"] = properties
    if undeclared:
        out["$comment"] = _UNDECLARED + ", ".join(sorted(undeclared))
    return out


def _field(node: dict[str, Any], definitions: dict[str, Any]) -> dict[str, Any] | None:
    """A field's schema, None where it cannot be said."""
    if "enum" in node and all(isinstance(value, str) for value in node["enum"]):
        node = {**node, "type": "string"}
    kind = node.get("type")
    if kind == "object":
        return _object(node, definitions)
    if kind == "array":
        return _array(node, definitions)
    return node if kind in _PLAIN else None


def _array(node: dict[str, Any], definitions: dict[str, Any]) -> dict[str, Any] | None:
    """Plain values or objects, all of one type: a tuple is a list of so many."""
    items = node.get("prefixItems") or [node.get("items", {})]
    said = [_field(_resolved(item, definitions), definitions) for item in items]
    first = said[0]
    if first is None or first["type"] == "array" or any(item != first for item in said):
        return None
    kept = (*_KEPT, "minItems", "maxItems")
    return {key: node[key] for key in kept if key in node} | {
        "type": "array",
        "items": first,
    }
