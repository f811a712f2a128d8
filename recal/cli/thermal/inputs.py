"""Options of `recal thermal` that take several runs."""

from __future__ import annotations

from typing import Any

from recal.cli.console import Command


class ManyRuns(Command):
    """`--fast A B --slow C` means `--fast A --fast B --slow C`."""

    MANY = ("--fast", "--slow", "--check")

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Each further word after one of MANY belongs to it."""
        spread: list[str] = []
        option, filled = "", False
        for word in args:
            if word.startswith("-"):
                option, filled = word if word in self.MANY else "", False
            elif option and filled:
                spread.append(option)
            else:
                filled = bool(option)
            spread.append(word)
        return super().parse_args(ctx, spread)
