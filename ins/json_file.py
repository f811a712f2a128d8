"""Reading JSON, TOML and small CSV that somebody else wrote: bounded, without NaN or repeated
keys, one clear line when wrong.

`parse` turns a plain dict into a pydantic model; `complaints` turns pydantic's errors into lines
that name the key.
"""

import csv
import difflib
import io
import json
import math
import re
import tomllib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from datetime import date, datetime, time
from decimal import Decimal
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from ins.records import InputError
from ins.user_input import read_bounded

MAX_JSON_BYTES = 4_000_000  # a table with covariance is below 1 MB
MAX_SHOWN = 60  # characters; chosen: file, key and 60 of the value fit a line
# Of a number: seconds since 1970 are 1.8e9; the fourth power still is a float64.
MAX_NUMBER = 1e15
MAX_DEPTH = 32  # of lists and keys within each other; what is read here has six
# no key: a kind that was tried
UNION_MEMBER = re.compile(
    r"(str|int|float|bool)|(list|dict|tuple|nullable|str-enum|constrained-|function-).*[\[-].*"
)
NEEDED_WORDS = {
    "string_type": "text",
    "float_type": "a number",
    "float_parsing": "a number",
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "int_from_float": "a whole number",
    "bool_type": "true or false",
    "list_type": "a list",
    "dict_type": "keys with values",
    "model_type": "keys with values",
    "dataclass_type": "keys with values",
    "tuple_type": "a list",
    "is_instance_of": "a list",
    "finite_number": "a finite number",
    "greater_than_equal": "at least {ge:g}",
    "greater_than": "more than {gt:g}",
    "less_than_equal": "at most {le:g}",
    "less_than": "less than {lt:g}",
    "too_short": "at least {min_length} values, not {actual_length}",
    "too_long": "at most {max_length} values, not {actual_length}",
    "string_too_short": "text that is not empty",
    "string_too_long": "text, its length at most {max_length}",
    "string_pattern_mismatch": "text that matches {pattern}",
}


class StrictModel(BaseModel):
    """Base of all file models: no coercion from text, no NaN or infinity, no unknown keys.

    A subclass may allow unknown keys.
    """

    model_config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False, frozen=True)


M = TypeVar("M", bound=BaseModel)
# What a file holds before it is checked; TOML also has times.
Json = str | int | float | bool | datetime | date | time | None | list["Json"] | dict[str, "Json"]
JsonObject = dict[str, Json]


class Written(float):
    """A number with the text that it was written as, whose digits say how well it is known.

    Parameters
    ----------
    text : str
        Such as "47.50", of which the float alone says 47.5.
    """

    def __new__(cls, text: str) -> "Written":
        number = super().__new__(cls, text)
        number.text = text.strip()
        return number

    text: str


def half_unit(number: float) -> float:
    """Half a unit of a number's last digit, as it was written.

    Parameters
    ----------
    number : float, int or Written
        Of a float that is not Written, the digits that Python gives it.

    Returns
    -------
    half_unit : float

    Examples
    --------
    >>> half_unit(48), half_unit(Written("47.50"))
    (0.5, 0.005)
    """
    text = number.text if isinstance(number, Written) else repr(number)
    return 0.5 * 10.0 ** int(Decimal(text).as_tuple().exponent)


def read_json_object(path: Path, *, number: Callable[[str], float] = float) -> JsonObject:
    """The object in a JSON file.

    Parameters
    ----------
    path : Path
        A file of at most MAX_JSON_BYTES.
    number : callable
        Makes what is not whole of its text: `Written` keeps that.

    Returns
    -------
    data : dict

    Raises
    ------
    InputError
        Names the file and what is wrong with it: unreadable, no JSON, no object, a key twice, NaN,
        nested more deeply than MAX_DEPTH.
    """
    text = read_small_text(path)
    if not text.strip():
        raise InputError(f"{path}: is empty, needed an object of JSON")
    try:
        data = json.loads(
            text, object_pairs_hook=_unique, parse_constant=_refuse_constant, parse_float=number
        )
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: not valid JSON ({_reason(error)})") from None
    if not isinstance(data, dict):
        raise InputError(f"{path}: holds {shown(data)}, needed an object of JSON")
    refuse_wild(_bounded(data, f"{path}: not valid JSON"), name=str(path))
    return data


def read_toml(path: Path) -> JsonObject:
    """The keys of a TOML file.

    Parameters
    ----------
    path : Path
        A file of at most MAX_JSON_BYTES.

    Returns
    -------
    data : dict

    Raises
    ------
    InputError
        Names the file and what is wrong with it.
    """
    return parse_toml(read_small_text(path), name=str(path))


def parse_toml(text: str, *, name: str) -> JsonObject:
    """The keys of a text of TOML.

    Parameters
    ----------
    text : str
        The text.
    name : str
        Its file; each error line begins with it.

    Returns
    -------
    data : dict

    Raises
    ------
    InputError
        Where the text is no TOML or nested more deeply than MAX_DEPTH.

    Examples
    --------
    >>> parse_toml("lat_deg = 45.0", name="site.toml")
    {'lat_deg': 45.0}
    """
    try:
        return _bounded(tomllib.loads(text, parse_float=Written), f"{name}: not valid TOML")
    except (ValueError, RecursionError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{name}: not valid TOML ({_reason(error)})") from None


def read_small_text(path: Path, *, most_bytes: int = MAX_JSON_BYTES) -> str:
    """The text of a small file.

    Parameters
    ----------
    path : Path
        The file.
    most_bytes : int
        A larger one is refused.

    Returns
    -------
    text : str
        Without a byte order mark.

    Raises
    ------
    InputError
        Where it cannot be read, is no regular file, larger or no UTF-8.
    """
    try:
        return read_bounded(path, most_bytes).decode("utf-8-sig")
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not UTF-8 text (byte {error.start})") from None


def read_csv_rows(path: Path) -> list[tuple[int, list[str]]]:
    """The rows of a small CSV file.

    Parameters
    ----------
    path : Path
        A file of at most MAX_JSON_BYTES.

    Returns
    -------
    rows : list of (int, list of str)
        The number of the line at which each row ends, and its fields; blank rows left out.

    Raises
    ------
    InputError
        Where the file cannot be read, or a quote is left open.
    """
    reader = csv.reader(io.StringIO(read_small_text(path), newline=""), strict=True)
    try:
        return [(reader.line_num, row) for row in reader if any(cell.strip() for cell in row)]
    except csv.Error as error:
        raise InputError(f"{path}: line {reader.line_num}: no row of a CSV ({error})") from None


def _bounded(data: JsonObject, what: str) -> JsonObject:
    """The same data; InputError where it is nested more deeply than MAX_DEPTH, or a text is no
    Unicode.
    """
    level: list[Any] = [data]
    for _ in range(MAX_DEPTH):
        level = [part for value in level for part in _parts(value, what)]
        if not level:
            return data
    raise InputError(f"{what} (nested too deeply, needed at most {MAX_DEPTH} levels)")


def _parts(value: Any, what: str) -> list[Any]:
    """What a list or the keys of an object hold; none of anything else."""
    if isinstance(value, dict):
        return [*value, *value.values()]
    if isinstance(value, str):
        try:
            value.encode()
        except UnicodeEncodeError:
            raise InputError(f"{what} (half a character in a text)") from None
    return value if isinstance(value, list) else []


def parse(model: type[M], data: Mapping[str, Json], *, name: str) -> M:
    """The model of a plain dict.

    Parameters
    ----------
    model : type of BaseModel
        What the keys must be.
    data : dict
        As read.
    name : str
        The file; the error line begins with it.

    Returns
    -------
    record : model

    Raises
    ------
    InputError
        With the first complaint.
    """
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise InputError(complaints(error, model, name=name)[0]) from None


def complaints(error: ValidationError, model: type, *, name: str) -> list[str]:
    """One line for each wrong key: file, key, what was got, what was needed.

    Parameters
    ----------
    error : ValidationError
        Of pydantic.
    model : type
        What the keys must be; misspelt keys are compared with it.
    name : str
        The file; each line begins with it.

    Returns
    -------
    lines : list of str
    """
    return [_complaint(item, model, name) for item in error.errors(include_url=False)]


def without_schema(data: Mapping[str, Json], schema: str, *, name: str) -> JsonObject:
    """The other keys of a file, once its key `schema` says what is expected.

    Parameters
    ----------
    data : dict
        As read.
    schema : str
        The schema that is needed.
    name : str
        The file; the error line begins with it.

    Returns
    -------
    data : dict
        Without the key `schema`.

    Raises
    ------
    InputError
        Where the schema is missing or another one.

    Examples
    --------
    >>> without_schema({"schema": "recal.twin/1", "gyro": {}}, "recal.twin/1", name="twin.json")
    {'gyro': {}}
    """
    if data.get("schema") != schema:
        got = (
            f"schema: got {shown(data['schema'])}" if "schema" in data else "key schema is missing"
        )
        raise InputError(f'{name}: {got}, needed "{schema}"')
    return {k: v for k, v in data.items() if k != "schema"}


def refuse_non_finite(value: Any, *, name: str, key: str = "") -> None:
    """Refuse NaN and infinity, at any depth.

    Parameters
    ----------
    value : object
        Dicts, lists and numbers.
    name : str
        The file; the error line begins with it.
    key : str
        Where `value` stands in it.

    Raises
    ------
    InputError
        Names the key.
    """
    for place, number in _numbers(value, key):
        if isinstance(number, float) and not math.isfinite(number):
            raise InputError(f"{name}: {place}: got {number}, needed a finite number")


def refuse_wild(value: Any, *, name: str, key: str = "") -> None:
    """Refuse numbers beyond MAX_NUMBER, at any depth.

    Parameters
    ----------
    value : object
        Dicts, lists and numbers.
    name : str
        The file; the error line begins with it.
    key : str
        Where `value` stands in it.

    Raises
    ------
    InputError
        Names the key.
    """
    for place, number in _numbers(value, key):
        if not abs(number) <= MAX_NUMBER:
            raise InputError(
                f"{name}: {place}: got {shown(number)}, needed within +-{MAX_NUMBER:g}"
            )


def _numbers(value: Any, key: str) -> Iterator[tuple[str, int | float]]:
    """Each number in dicts and lists at any depth, and the key where it stands."""
    if isinstance(value, dict):
        for k, v in value.items():
            yield from _numbers(v, f"{key}.{k}" if key else str(k))
    elif isinstance(value, list | tuple):
        for i, v in enumerate(value):
            yield from _numbers(v, f"{key}[{i}]")
    elif isinstance(value, int | float):
        yield key, value


def _complaint(item: Any, model: type, name: str) -> str:
    loc = [
        part for part in item["loc"] if isinstance(part, int) or not UNION_MEMBER.fullmatch(part)
    ]
    key = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in loc).lstrip(".")
    if item["type"] == "missing":
        return f"{name}: key {key} is missing"
    if item["type"] == "extra_forbidden":
        return f"{name}: unknown key {key}{_suggestion(item['loc'], model)}"
    return (
        f"{name}: {key}: got {shown(item['input'])}, needed"
        f" {needed(item['type'], item.get('ctx', {}))}"
    )


def shown(value: Any) -> str:
    """A value as its file writes it, cut short.

    Parameters
    ----------
    value : object
        As read.

    Returns
    -------
    text : str
        Of at most MAX_SHOWN characters and an ellipsis; text in quotes, so that "45" is not taken
        for 45.

    Examples
    --------
    >>> shown("45")
    '"45"'
    """
    text = json.dumps(value, default=str, ensure_ascii=False)
    return text if len(text) <= MAX_SHOWN else f"{text[:MAX_SHOWN]}..."


def _reason(error: Exception) -> str:
    return (
        "nested too deeply"
        if isinstance(error, RecursionError)
        else " ".join(str(error).split())[:200]
    )


def needed(kind: str, facts: Mapping[str, Json]) -> str:
    """What a value must be, of a fault that pydantic found.

    Parameters
    ----------
    kind : str
        The type of the fault.
    facts : dict
        Its context, such as the limit.

    Returns
    -------
    words : str

    Examples
    --------
    >>> needed("less_than_equal", {"le": 0.5})
    'at most 0.5'
    """
    if kind == "value_error":
        return str(facts["error"])
    if kind in ("literal_error", "enum"):
        return str(facts["expected"]).replace("'", "")
    return NEEDED_WORDS.get(kind, f"another value ({kind})").format(**facts)


def _suggestion(loc: tuple, model: Any) -> str:
    for part in loc[:-1]:
        if isinstance(part, int) or part not in getattr(model, "model_fields", {}):
            return ""
        model = model.model_fields[part].annotation
    near = difflib.get_close_matches(str(loc[-1]), getattr(model, "model_fields", {}), n=1)
    return f" (did you mean {near[0]}?)" if near else ""


def _unique(pairs: list[tuple[str, Json]]) -> JsonObject:
    data = dict(pairs)
    if len(data) != len(pairs):
        twice = next(k for k, count in Counter(k for k, _ in pairs).items() if count > 1)
        raise ValueError(f"key {twice!r} appears twice")
    return data


def _refuse_constant(text: str) -> float:
    raise ValueError(f"{text} is not a number in JSON")
