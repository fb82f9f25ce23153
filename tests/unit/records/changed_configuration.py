"""A configuration with other values of its plan, its facts, or its own fields, by their names."""

from __future__ import annotations

import dataclasses
from typing import Any

import msgspec

from markerseek.core import RigFacts, SearchPlan
from markerseek.records.journal import Configuration


def changed(configuration: Configuration, **changes: Any) -> Configuration:
    plan = {field.name: changes.pop(field.name) for field in dataclasses.fields(SearchPlan) if field.name in changes}
    facts = {field.name: changes.pop(field.name) for field in dataclasses.fields(RigFacts) if field.name in changes}
    return msgspec.structs.replace(
        configuration,
        plan=dataclasses.replace(configuration.plan, **plan),
        facts=dataclasses.replace(configuration.facts, **facts),
        **changes,
    )
