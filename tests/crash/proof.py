"""A workload watched, every state it may leave behind laid out, opened and checked."""

from __future__ import annotations

import logging
import os
import shutil
import tempfile
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

from tests.crash.disk import Tree, identified, states
from tests.crash.marks import Promises
from tests.crash.shim import Operation, read_log

Check = Callable[[Path, Promises], list[str]]


@dataclass
class Verdict:
    """How many states of which kind, and what was wrong with which."""

    states: Counter[str] = field(default_factory=Counter)
    operations: int = 0
    promises: int = 0
    """Things shown as saved by the end of the workload."""
    wrong: list[str] = field(default_factory=list)
    raw_lost_s: float = 0.0
    """The most of any cut."""
    stood_s: float = 0.0
    """The longest time that the machine had none for the workload."""

    @property
    def unreadable(self) -> int:
        return sum("unreadable" in sentence for sentence in self.wrong)

    @property
    def lost(self) -> int:
        return len(self.wrong) - self.unreadable

    def __iadd__(self, other: Verdict) -> Verdict:
        self.states += other.states
        self.operations += other.operations
        self.promises += other.promises
        self.wrong += other.wrong
        self.raw_lost_s = max(self.raw_lost_s, other.raw_lost_s)
        self.stood_s = max(self.stood_s, other.stood_s)
        return self


def replay(
    log: Sequence[Operation],
    check: Check,
    seed: int,
    samples: int = 1000,
    limit: int | None = None,
    ignored: Sequence[str] = (),
) -> Verdict:
    """Open every state that a cut during ``log`` may leave, or ``limit`` of them, drawn by lot."""
    logging.disable(logging.CRITICAL)  # thousands of recoveries, each with its warning
    operations = identified(log, ignored)
    rng = Random(seed)
    found = list(states(operations, rng, samples))
    if limit is not None and len(found) > limit:
        found = rng.sample(found, limit)
    found.sort(key=lambda state: state.cut)
    verdict = Verdict(operations=sum(op.op != "mark" for op in operations))
    promises, taken = Promises(), 0
    with tempfile.TemporaryDirectory(prefix="crash-", dir=memory()) as scratch:
        for state in found:
            promises.take(operations[taken : state.cut])
            taken = state.cut
            promises.now_ns = operations[min(state.cut, len(operations) - 1)].ns
            folder = Path(scratch) / "disk"
            folder.mkdir()
            state.tree.write_to(folder)
            verdict.states[state.kind] += 1
            verdict.wrong += [f"cut {state.cut} ({state.kind}): {sentence}" for sentence in check(folder, promises)]
            shutil.rmtree(folder)
    logging.disable(logging.NOTSET)
    verdict.raw_lost_s = promises.raw_lost_s
    promises.take(operations[taken:])
    verdict.stood_s = promises.stood_s
    verdict.promises = len(promises.shown)
    return verdict


def memory() -> Path | None:
    """A folder in memory, where there is one: what is only looked at needs no disk under it."""
    shared = Path("/dev/shm")
    return shared if os.access(shared, os.W_OK) else None


def missed(log: Path, folder: Path, ignored: Sequence[str] = ()) -> list[str]:
    """Files of ``folder`` that are not what the log says they are: something got past the shim."""
    tree = Tree()
    for op in identified(list(read_log(log)), ignored):
        tree.apply(op)
    said = tree.content()
    there = {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and not str(path).endswith(tuple(ignored))
    }
    return sorted({name for name in (*said, *there) if said.get(name) != there.get(name)})
