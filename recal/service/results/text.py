"""The JSON of a result, in files and on standard output. Loads no heavy library by itself."""

import json
from collections.abc import Mapping
from typing import Any


def result_text(result: object) -> str:
    """The one JSON form of a result, a record or made of records; numbers that are not finite
    become null.
    """
    from ins.verdicts import plain

    return json.dumps(_finite(plain(result)), indent=1, allow_nan=False) + "\n"


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
