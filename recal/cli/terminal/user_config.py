"""The user's own defaults: `config.toml` in the configuration folder of the operating system.

Loads no numerical library: every command reads it before its options.
"""

import tomllib
from dataclasses import dataclass, fields
from pathlib import Path

from ins.user_input import read_bounded
from recal.service.results.issuer import Issuer

FILE = "config.toml"
MAX_DEFAULTS_BYTES = 100_000  # chosen: six keys of some 100 characters


@dataclass(frozen=True, kw_only=True)
class UserConfig(Issuer):
    """What the file may say, empty where it does not: who issues reports, the operator among them,
    who proposes and approves; store: URL of the default store.
    """

    store: str = ""


def config_path() -> Path:
    """Where the file is looked for."""
    from platformdirs import user_config_path

    return user_config_path("recal", appauthor=False) / FILE


def read_user_config(path: Path | None = None) -> UserConfig:
    """The file's values; those of nobody where there is no file.

    InputError names the file and the key that is not known, or whose value is no text.
    """
    file = config_path() if path is None else path
    try:
        given = tomllib.loads(read_bounded(file, MAX_DEFAULTS_BYTES).decode("utf-8"))
    except (FileNotFoundError, NotADirectoryError):
        return UserConfig()
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise _input_error(f"{file}: cannot be read ({error})") from None
    known = [f.name for f in fields(UserConfig)]
    for key, value in given.items():
        if key not in known:
            raise _input_error(f"{file}: key {key!r}, needed one of {', '.join(known)}")
        if not isinstance(value, str):
            raise _input_error(f"{file}: {key} = {value!r}, needed a text in quotes")
    return UserConfig(**given)


def _input_error(line: str) -> Exception:
    from ins.records import InputError

    return InputError(line)
