"""Collects the mistakes of a scenario file."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TypeVar

from pydantic import BaseModel, ValidationError

from register_maps.error_texts import explain_error
from register_maps.errors import Finding
from register_maps.source import KeyPath, Source

Model = TypeVar("Model", bound=BaseModel)


@dataclass(slots=True)
class Mistakes:
    """The mistakes of one file."""

    source: Source
    findings: list[Finding] = field(default_factory=list)

    def add(self, path: KeyPath, message: str, *, replace: bool = False) -> None:
        """Add a mistake at its place. A second one there follows from the first and is left out, unless it is to replace the first."""
        finding = self.source.finding(path, message)
        if replace:
            self.findings = [known for known in self.findings if (known.line, known.key) != (finding.line, finding.key)]
        if all((finding.line, finding.key) != (known.line, known.key) for known in self.findings):
            self.findings.append(finding)

    def model(self, raw: object, path: KeyPath, model: type[Model]) -> Model | None:
        """Read a part of the file as a model; None if it has mistakes."""
        try:
            return model.model_validate_json(json.dumps(raw), strict=True)
        except ValidationError as error:
            schema, written = model.model_json_schema(), _below(self.source.written, path)
            for entry in error.errors(include_url=False):
                place, message = explain_error(entry, schema, raw, written)
                self.add((*path, *place), message)
            return None


def _below(written: Mapping[tuple[str, ...], str], path: KeyPath) -> Mapping[tuple[str, ...], str]:
    names = tuple(map(str, path))
    return {key[len(names) :]: text for key, text in written.items() if key[: len(names)] == names}
