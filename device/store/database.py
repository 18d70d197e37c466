"""The SQLite file: opened, checked, migrated; one writer at a time, every commit on the disk before it returns."""

from __future__ import annotations

import errno
import logging
import re
import sqlite3
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.resources import files
from pathlib import Path

from device.durable import make_folder
from device.errors import StorageFull, StoreUnusable

log = logging.getLogger(__name__)

FILE_NAME = "borescout.db"
_FULL_SENTENCE = "The disk is full: free some space, then measure again."


def migrations() -> list[tuple[int, str]]:
    """(number, SQL) of every migration, in order. Their files are called ``NNNN_what.sql``."""
    found = []
    for file in files("device.store").joinpath("migrations").iterdir():
        match = re.fullmatch(r"(\d{4})_\w+\.sql", file.name)
        if match:
            found.append((int(match[1]), file.read_text(encoding="utf-8")))
    return sorted(found)


class Database:
    """One SQLite file in WAL mode with ``synchronous=FULL``.

    A damaged file is set aside, never deleted, and a new one is begun; ``notice`` then says so. Raises StoreUnusable where the
    folder cannot be used or the file was written by a newer program, StorageFull where there is no room.
    """

    def __init__(self, folder: Path) -> None:
        self.path = folder / FILE_NAME
        self.notice: str | None = None
        self._lock = threading.RLock()
        try:
            make_folder(folder)
        except OSError as error:
            raise StoreUnusable(f"The data folder {folder} cannot be made: {error.strerror}.") from None
        try:
            self._connection = self._open()
        except _Damaged as damage:
            aside = _set_aside(self.path)
            self.notice = (
                f"The database was damaged ({damage.what}) and has been set aside as {aside.name}; a new one was begun."
            )
            log.error("%s", self.notice)
            try:
                self._connection = self._open()
            except _Damaged as again:
                raise StoreUnusable(f"The data folder {folder} does not keep what is written to it: {again.what}.") from None

    def _open(self) -> sqlite3.Connection:
        with _translated(self.path):
            connection = sqlite3.connect(self.path, timeout=5.0, isolation_level=None, check_same_thread=False)
            try:
                connection.row_factory = sqlite3.Row
                connection.execute("PRAGMA journal_mode = WAL")
                connection.execute("PRAGMA synchronous = FULL")
                connection.execute("PRAGMA foreign_keys = ON")
                verdict = connection.execute("PRAGMA quick_check(1)").fetchone()[0]
                if verdict != "ok":
                    raise _Damaged(self.path, str(verdict).splitlines()[0])
                self._migrate(connection)
            except BaseException:
                connection.close()
                raise
            return connection

    def _migrate(self, connection: sqlite3.Connection) -> None:
        version = int(connection.execute("PRAGMA user_version").fetchone()[0])
        steps = migrations()
        if version > steps[-1][0]:
            raise StoreUnusable(
                f"The findings in {self.path} were written by a newer borescout (schema {version}, this one knows"
                f" {steps[-1][0]}): update the program or choose another --data-dir."
            )
        for number, sql in steps:
            if number <= version:
                continue
            try:
                connection.executescript(f"BEGIN IMMEDIATE;\n{sql}\nPRAGMA user_version = {number};\nCOMMIT;")
            except sqlite3.Error:
                if connection.in_transaction:
                    connection.execute("ROLLBACK")
                raise
            log.info("database %s is now at schema %d", self.path, number)

    @contextmanager
    def write(self) -> Iterator[sqlite3.Connection]:
        """A transaction: durable when the block ends, undone when it raises. Raises StorageFull."""
        with self._lock, _translated(self.path):
            self._connection.execute("BEGIN IMMEDIATE")
            try:
                yield self._connection
                self._connection.execute("COMMIT")
            except BaseException:
                if self._connection.in_transaction:
                    self._connection.execute("ROLLBACK")
                raise

    @contextmanager
    def read(self) -> Iterator[sqlite3.Connection]:
        """The connection, for queries."""
        with self._lock, _translated(self.path):
            yield self._connection

    def close(self) -> None:
        """Fold the write-ahead log into the file and close. May be called twice."""
        with self._lock:
            self._connection.close()


class _Damaged(StoreUnusable):
    """The file is not a sound database."""

    def __init__(self, path: Path, what: str) -> None:
        super().__init__(f"The database {path} is damaged ({what}): start borescout again, which sets it aside.")
        self.what = what


@contextmanager
def _translated(path: Path) -> Iterator[None]:
    try:
        yield
    except sqlite3.OperationalError as error:
        if error.sqlite_errorcode & 0xFF == sqlite3.SQLITE_FULL:
            raise StorageFull(_FULL_SENTENCE) from error
        if error.sqlite_errorcode & 0xFF in (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB):
            raise _Damaged(path, str(error)) from error
        raise StoreUnusable(f"The database {path} cannot be used: {error}.") from error
    except sqlite3.DatabaseError as error:
        code = getattr(error, "sqlite_errorcode", 0) & 0xFF
        if code in (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB):
            raise _Damaged(path, str(error)) from error
        raise
    except OSError as error:
        if error.errno == errno.ENOSPC:
            raise StorageFull(_FULL_SENTENCE) from error
        raise


def _set_aside(path: Path) -> Path:
    number = 1
    while (aside := path.with_name(f"{path.name}.damaged-{number}")).exists():
        number += 1
    for suffix in ("", "-wal", "-shm"):
        part = path.with_name(path.name + suffix)
        if part.exists():
            part.rename(aside.with_name(aside.name + suffix))
    return aside
