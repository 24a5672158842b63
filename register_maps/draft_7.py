"""Writes JSON Schemas as draft 7, which editors use for completion. Pure."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any


def draft_7_text(schema: Mapping[str, Any]) -> str:
    """Return the text of a schema file, from a schema as pydantic makes it."""
    return json.dumps({"$schema": "http://json-schema.org/draft-07/schema#", **_draft_7(schema)}, indent=2) + "\n"


def _draft_7(node: Any) -> Any:
    """Translate to draft 7: `definitions` for `$defs`, `items` and `additionalItems` for `prefixItems`."""
    if isinstance(node, list):
        return [_draft_7(item) for item in node]
    if not isinstance(node, Mapping):
        return node.replace("#/$defs/", "#/definitions/") if isinstance(node, str) else node
    new = {{"$defs": "definitions", "prefixItems": "items"}.get(key, key): _draft_7(item) for key, item in node.items()}
    if "prefixItems" in node:
        new["additionalItems"] = False
    return new
