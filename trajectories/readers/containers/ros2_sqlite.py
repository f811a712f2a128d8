"""ROS 2 bags in SQLite (.db3): rows of the tables `topics` and `messages`, in the order they were
written.

The file is opened read-only and never changed. SQLite itself stops where a file is damaged; the
rows before stay.
"""

import json
import sqlite3
from pathlib import Path

from ins.records import InputError
from trajectories.readers.containers.ros_messages import Bag, Topic
from trajectories.readers.containers.unpacking import Damaged, unpacked
from trajectories.runs.notes import About, Note

SQLITE_MAGIC = b"SQLite format 3\0"
MAX_VALUE_BYTES = 1 << 28
# Of SQLite's machine: a query over a file ends well before.
STEPS_PER_BYTE = 200
LEAST_STEPS = 10**8
ROWS_BETWEEN_LOOKS = 10_000  # between two looks at the count
ZSTD = b"\x28\xb5\x2f\xfd"


def read_sqlite(path: Path, bag: Bag, label: str) -> None:
    """Take up the messages of a file; what cannot be read goes to the bag's notes. InputError where
    it is no such bag.
    """
    wal = path.with_name(f"{path.name}-wal")
    if wal.exists() and wal.stat().st_size:
        bag.note(
            f"{label}: recording not finished: what is in {wal.name} is not read (close it with"
            " sqlite3 first)"
        )
    connection = sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro&immutable=1", uri=True)
    try:
        connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAX_VALUE_BYTES)
        connection.execute("PRAGMA trusted_schema = OFF")
        connection.set_progress_handler(_Budget(path.stat().st_size), ROWS_BETWEEN_LOOKS)
        connection.text_factory = lambda data: data.decode("utf-8", errors="replace")
        topics = _topics(connection, bag, label)
        _messages(connection, topics, bag, label)
    except (sqlite3.DatabaseError, UnicodeDecodeError) as error:
        # the latter of a message about garbled names
        raise InputError(
            f"{label}: not a ROS 2 bag that can be read ({' '.join(str(error).split())[:80]})"
        ) from None
    finally:
        connection.close()


class _Budget:
    """Ends a query that takes more steps than reading a file of this size may take (a hostile view
    never ends).
    """

    def __init__(self, size: int) -> None:
        self._left = max(LEAST_STEPS, STEPS_PER_BYTE * size) // ROWS_BETWEEN_LOOKS

    def __call__(self) -> int:
        self._left -= 1
        return int(self._left < 0)


def _topics(connection: sqlite3.Connection, bag: Bag, label: str) -> dict[int, Topic]:
    kinds = dict(
        connection.execute(
            "SELECT name, type FROM sqlite_master WHERE name IN ('topics', 'messages')"
        ).fetchall()
    )
    if kinds != {"topics": "table", "messages": "table"}:
        raise InputError(f"{label}: not a ROS 2 bag: no tables topics and messages")
    rows = connection.execute("SELECT id, name, type, serialization_format FROM topics").fetchall()
    found = {
        number: bag.topic(*(str(text) for text in texts))
        for number, *texts in rows
        if isinstance(number, int)
    }
    return {number: topic for number, topic in found.items() if topic is not None}


def _messages(
    connection: sqlite3.Connection, topics: dict[int, Topic], bag: Bag, label: str
) -> None:
    rows = connection.execute(
        "SELECT topic_id, timestamp, data FROM messages"
        " WHERE topic_id IN (SELECT value FROM json_each(?)) ORDER BY id",
        (json.dumps(list(topics)),),
    )
    count = 0
    try:
        for number, received, data in rows:
            count, topic = count + 1, topics[number]
            if not isinstance(data, bytes) or not isinstance(received, int):
                topic.damaged += 1
                continue
            topic.take(received, _plain(data))
    except (sqlite3.DatabaseError, UnicodeDecodeError) as error:
        why = " ".join(str(error).split())[:80]
        told = f"{label}: damaged ({why}): read up to message {count}, what follows dropped"
        bag.note(Note(told, About.DAMAGE))


def _plain(data: bytes) -> bytes:
    """A message as it was sent, be it packed on its own; nothing where it cannot be unpacked."""
    if not data.startswith(ZSTD):
        return data
    try:
        return unpacked(memoryview(data), "zstd")
    except Damaged:
        return b""
