"""The JSON of a result, in files and on standard output. Loads no heavy library."""

import json
from collections.abc import Mapping
from typing import Any

Document = Mapping[str, Any]  # a result as JSON holds it (docs: the file formats, results)


def result_text(document: Document) -> str:
    """The one JSON form of a result; numbers that are not finite become null."""
    return json.dumps(_finite(document), indent=1, allow_nan=False) + "\n"


def _finite(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {k: _finite(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(v) for v in value]
    if hasattr(value, "tolist"):
        return _finite(value.tolist())
    if (isinstance(value, float) and value != value) or value in (float("inf"), float("-inf")):
        return None
    return value
