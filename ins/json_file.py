"""Reading JSON objects that somebody else wrote: bounded, without NaN or repeated keys, one clear line when wrong.

`parse` turns a plain dict into a pydantic model; `complaints` turns pydantic's errors into lines that name the key.
"""

import difflib
import json
import math
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from ins.records import InputError

MAX_JSON_BYTES = 4_000_000  # a table with covariance is below 1 MB


class StrictModel(BaseModel):
    """Base of all file models: no coercion from text, no NaN or inf, unknown keys refused unless a subclass allows."""

    model_config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False, frozen=True)


M = TypeVar("M", bound=BaseModel)


def read_json_object(path: Path) -> dict[str, Any]:
    """The object in a JSON file; InputError names the file and what is wrong with it."""
    try:
        if path.stat().st_size > MAX_JSON_BYTES:
            raise InputError(f"{path}: {path.stat().st_size} bytes, needed at most {MAX_JSON_BYTES}")
        data = json.loads(
            path.read_text(encoding="utf-8-sig"), object_pairs_hook=_unique, parse_constant=_refuse_constant
        )
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: not valid JSON ({' '.join(str(error).split())[:200]})") from None
    if not isinstance(data, dict):
        raise InputError(f"{path}: holds a JSON {type(data).__name__}, needed an object")
    return data


def parse(model: type[M], data: dict[str, Any], *, name: str) -> M:
    """The model of a plain dict; InputError with the first complaint, `name` being the file."""
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise InputError(complaints(error, model, name=name)[0]) from None


def complaints(error: ValidationError, model: type[BaseModel], *, name: str) -> list[str]:
    """One line for each wrong key: file, key, what was got, what was needed."""
    return [_complaint(item, model, name) for item in error.errors(include_url=False)]


def without_schema(data: dict[str, Any], schema: str, *, name: str) -> dict[str, Any]:
    """The other keys, once `schema` says what is expected."""
    if data.get("schema") != schema:
        raise InputError(f"{name}: schema: got {str(data.get('schema'))[:60]!r}, needed {schema!r}")
    return {k: v for k, v in data.items() if k != "schema"}


def refuse_non_finite(value: Any, *, name: str, key: str = "") -> None:
    """InputError naming the key of any NaN or infinity, at any depth."""
    if isinstance(value, dict):
        for k, v in value.items():
            refuse_non_finite(v, name=name, key=f"{key}.{k}" if key else str(k))
    elif isinstance(value, list | tuple):
        for i, v in enumerate(value):
            refuse_non_finite(v, name=name, key=f"{key}[{i}]")
    elif isinstance(value, float) and not math.isfinite(value):
        raise InputError(f"{name}: {key}: got {value}, needed a finite number")


def _complaint(item: Any, model: type[BaseModel], name: str) -> str:
    key = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in item["loc"]).lstrip(".")
    if item["type"] == "missing":
        return f"{name}: key {key} is missing"
    if item["type"] == "extra_forbidden":
        return f"{name}: unknown key {key}{_suggestion(item['loc'], model)}"
    needed = item["msg"].removeprefix("Input should be ").removeprefix("Value error, ")
    return f"{name}: {key}: got {str(item['input'])[:60]!r}, needed {needed}"


def _suggestion(loc: tuple, model: Any) -> str:
    for part in loc[:-1]:
        if isinstance(part, int) or part not in getattr(model, "model_fields", {}):
            return ""
        model = model.model_fields[part].annotation
    near = difflib.get_close_matches(str(loc[-1]), getattr(model, "model_fields", {}), n=1)
    return f" (did you mean {near[0]}?)" if near else ""


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    keys = [k for k, _ in pairs]
    if len(set(keys)) != len(keys):
        raise ValueError(f"key {next(k for k in keys if keys.count(k) > 1)!r} appears twice")
    return dict(pairs)


def _refuse_constant(text: str) -> float:
    raise ValueError(f"{text} is not a number in JSON")
