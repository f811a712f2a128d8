"""What a long command is doing, on a terminal; nothing when piped."""

from types import TracebackType


class Progress:
    """A line on standard error that says what is being done while it lasts; call it with the
    words.
    """

    def __init__(self, title: str, *, quiet: bool) -> None:
        from rich.console import Console

        console = Console(stderr=True)
        self._status = console.status(title) if console.is_terminal and not quiet else None

    def __enter__(self) -> "Progress":
        if self._status is not None:
            self._status.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._status is not None:
            self._status.stop()

    def __call__(self, what: str) -> None:
        if self._status is not None:
            self._status.update(what)
