"""What is said of a wrong key is said in this program's words, whatever the kind of fault."""

import typing
from typing import Annotated, Any, Literal

import pytest
from pydantic import Field

from ins.json_file import (
    MAX_JSON_BYTES,
    NEEDED_WORDS,
    StrictModel,
    parse,
    read_json_object,
    read_toml,
)
from ins.records import InputError


class Inner(StrictModel):
    n: int = 1


class Model(StrictModel):
    number: float = 1.0
    whole: int = 1
    flag: bool = True
    text: Annotated[str, Field(min_length=1, max_length=3)] = "a"
    form: Annotated[str, Field(pattern="^[xyz]$")] = "x"
    kind: Literal["rlg", "fog"] = "rlg"
    low: Annotated[float, Field(ge=1, le=2)] = 1.0
    inside: Annotated[float, Field(gt=1, lt=2)] = 1.5
    three: Annotated[list[float], Field(min_length=3, max_length=3)] = Field(default_factory=list)
    keys: dict[str, Any] = Field(default_factory=dict)
    inner: Inner = Inner()
    either: str | list[str] = "a"


@pytest.mark.parametrize(
    ("key", "value", "line"),
    [
        ("number", "1", 'number: got "1", needed a number'),
        ("number", None, "number: got null, needed a number"),
        ("number", float("inf"), "number: got Infinity, needed a finite number"),
        ("whole", 1.5, "whole: got 1.5, needed a whole number"),
        ("whole", "1", 'whole: got "1", needed a whole number'),
        ("flag", 1, "flag: got 1, needed true or false"),
        ("text", 5, "text: got 5, needed text"),
        ("text", "", 'text: got "", needed text that is not empty'),
        ("text", "abcd", 'text: got "abcd", needed text, its length at most 3'),
        ("form", "q", 'form: got "q", needed text that matches ^[xyz]$'),
        ("kind", "mems", 'kind: got "mems", needed rlg or fog'),
        ("low", 0.5, "low: got 0.5, needed at least 1"),
        ("low", 3, "low: got 3, needed at most 2"),
        ("inside", 1, "inside: got 1, needed more than 1"),
        ("inside", 2.0, "inside: got 2.0, needed less than 2"),
        ("three", 1, "three: got 1, needed a list"),
        ("three", [1, 2], "three: got [1, 2], needed at least 3 values, not 2"),
        ("three", [1, 2, 3, 4], "three: got [1, 2, 3, 4], needed at most 3 values, not 4"),
        ("three", [1, "a", 3], 'three[1]: got "a", needed a number'),
        ("keys", [], "keys: got [], needed keys with values"),
        ("inner", 5, "inner: got 5, needed keys with values"),
        ("inner", {"m": 1}, "unknown key inner.m"),
        ("either", 5, "either: got 5, needed text"),
        ("text", "x" * 80, 'text: got "' + "x" * 59 + "..., needed text"),
    ],
)
def test_each_kind_of_fault(key, value, line):
    with pytest.raises(InputError) as caught:
        parse(Model, {key: value}, name="f.json")
    said = str(caught.value)
    assert said.startswith(f"f.json: {line}") and "nput should" not in said


def test_words_are_keyed_by_kinds_that_pydantic_has():
    from pydantic_core.core_schema import ErrorType

    assert set(NEEDED_WORDS) <= set(typing.get_args(ErrorType))


@pytest.mark.parametrize(
    ("content", "why"),
    [
        (b"", "is empty"),
        (b"\xff\xfe", "not UTF-8 text (byte 0)"),
        (b"{", "not valid JSON"),
        (b"5", "holds 5, needed an object"),
        (b" " * (MAX_JSON_BYTES + 1), "needed at most"),
        (b"[" * 100_000, "nested too deeply"),
    ],
)
def test_files_that_hold_no_object(tmp_path, content, why):
    path = tmp_path / "f.json"
    path.write_bytes(content)
    with pytest.raises(InputError, match=f"{path}: ") as caught:
        read_json_object(path)
    assert why in str(caught.value) and "\n" not in str(caught.value)


def test_toml_says_where(tmp_path):
    (tmp_path / "f.toml").write_text("a = 1\nb 2")
    with pytest.raises(InputError, match=r"f.toml: not valid TOML \(.*line 2"):
        read_toml(tmp_path / "f.toml")
    with pytest.raises(InputError, match=r"cannot be read \(Is a directory\)"):
        read_toml(tmp_path)
