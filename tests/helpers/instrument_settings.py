"""Instruments of any kind with any sizes, for properties that all of them have."""

from __future__ import annotations

from typing import get_args

from hypothesis import strategies as st

from errormodel.instruments.base import Instrument


def settings_of(kind: type[Instrument]) -> st.SearchStrategy[Instrument]:
    """An instrument of a kind with any sizes, by the schema of its own fields."""

    def number(schema: dict[str, object]) -> st.SearchStrategy[object]:
        schema = dict(schema.get("anyOf", [schema])[0])  # type: ignore[index]  # or nothing: see the contract test
        if schema.get("type") == "array":
            most = schema.get("maxItems", 3)
            assert isinstance(most, int)
            return st.lists(number(dict(schema["items"])), min_size=most, max_size=most)  # type: ignore[call-overload]
        return st.floats(1e-6, 1e-2)

    fields = kind.model_json_schema()["properties"]
    word = {"type": st.just(*get_args(kind.model_fields["type"].annotation))}
    sizes = {name: number(schema) for name, schema in fields.items() if name != "type"}
    return st.fixed_dictionaries(word | sizes).map(lambda values: kind(**values))
