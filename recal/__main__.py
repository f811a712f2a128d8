"""`recal` and `python -m recal`: runs the command line, turns bad input into one line and exit code 3."""

import sys


def main() -> None:
    from ins.records import InputError
    from recal.cli import app
    from recal.console import BAD_INPUT

    try:
        app()
    except InputError as error:
        print(f"recal: {error}", file=sys.stderr)
        sys.exit(BAD_INPUT)
    except BrokenPipeError:
        sys.exit(0)


if __name__ == "__main__":
    main()
