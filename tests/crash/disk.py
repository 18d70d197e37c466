"""What may lie on the disk after a power cut, given what a program asked of it.

The disk is a weak one: of everything that was not synced any part may have arrived, in any order, each write by sectors; a name
that was made, changed or removed counts once its folder was synced. Real file systems promise more (a journal keeps the order
of names), so that what survives here survives there.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations, pairwise
from pathlib import Path
from random import Random

from tests.crash.shim import Operation

SECTOR = 512
ALL_SUBSETS = 8
"""Of so many unsynced operations every subset is tried, of more a sample."""
_NAMES = ("create", "rename", "unlink", "mkdir", "rmdir")


@dataclass
class Tree:
    """Files by identity (one that was unlinked and made anew is another), names, folders."""

    files: dict[int, bytes] = field(default_factory=dict)
    names: dict[str, int] = field(default_factory=dict)
    folders: set[str] = field(default_factory=set)

    def copy(self) -> Tree:
        return Tree(dict(self.files), dict(self.names), set(self.folders))

    def apply(self, op: Operation) -> None:
        """One operation; one whose name never came to be changes nothing."""
        if op.op == "write":
            before = self.files.get(op.inode, b"")
            gap = b"\0" * max(0, op.offset - len(before))
            self.files[op.inode] = before[: op.offset] + gap + op.data + before[op.offset + len(op.data) :]
        elif op.op == "truncate":
            before = self.files.get(op.inode, b"")
            self.files[op.inode] = before[: op.offset] + b"\0" * max(0, op.offset - len(before))
        elif op.op == "create":
            self.names[op.path] = op.inode
        elif op.op == "unlink":
            self.names.pop(op.path, None)
        elif op.op == "mkdir":
            self.folders.add(op.path)
        elif op.op == "rmdir":
            self.folders.discard(op.path)
        elif op.op == "rename":
            moved = {name: number for name, number in self.names.items() if name == op.path or name.startswith(op.path + "/")}
            for name, number in moved.items():
                del self.names[name]
                self.names[op.path2 + name[len(op.path) :]] = number
            for folder in [f for f in self.folders if f == op.path or f.startswith(op.path + "/")]:
                self.folders.discard(folder)
                self.folders.add(op.path2 + folder[len(op.path) :])

    def content(self) -> dict[str, bytes]:
        """Path: bytes, of what can be reached."""
        return {
            name: self.files.get(number, b"")
            for name, number in self.names.items()
            if all(str(parent) in self.folders for parent in list(Path(name).parents)[:-1])
        }

    def write_to(self, folder: Path) -> None:
        """Lay it out in ``folder``, which is empty."""
        for path in sorted(self.folders):
            if all(str(parent) in self.folders for parent in list(Path(path).parents)[:-1]):
                (folder / path).mkdir()
        for path, data in self.content().items():
            (folder / path).write_bytes(data)

    def key(self) -> bytes:
        """The same for two trees that a program cannot tell apart."""
        digest = hashlib.blake2b(digest_size=16)
        for path, data in sorted(self.content().items()):
            digest.update(path.encode() + b"\0" + len(data).to_bytes(8, "little") + data)
        for path in sorted(self.folders):
            digest.update(path.encode() + b"\0/")
        return digest.digest()


@dataclass(frozen=True)
class State:
    """What lies on the disk when the power went right before operation number ``cut`` of the log: what was durable, and the
    operations beyond that arrived."""

    durable: Tree
    arrived: Sequence[Operation]
    cut: int
    kind: str
    """prefix, subset, torn or sample"""

    @property
    def tree(self) -> Tree:
        """Made anew each time: thousands of them would fill the memory."""
        tree = self.durable.copy()
        for op in self.arrived:
            tree.apply(op)
        return tree


def identified(log: Sequence[Operation], ignored: Sequence[str] = ()) -> list[Operation]:
    """The log with an identity of its own for each file that was made, since a file system gives inodes anew. What befalls
    paths that end with one of ``ignored`` is left out."""
    numbers: dict[int, int] = {}
    found, skipped = [], set[int]()
    for position, op in enumerate(log):
        if op.op == "create":
            numbers[op.inode] = position + 1
        number = numbers.setdefault(op.inode, -op.inode)
        if op.path.endswith(tuple(ignored)) and op.op not in ("mark", "sync folder") and ignored:
            skipped.add(number)
            continue
        found.append(replace(op, inode=number))
    return [op for op in found if op.inode not in skipped or op.op in ("mark", "sync folder", "mkdir", "rmdir")]


def states(log: Sequence[Operation], rng: Random, samples: int = 1000, torn_each: int = 3) -> Iterator[State]:
    """Every state once, the latest cut it can come from; ``log`` from ``identified``.

    A set of unsynced operations only grows until something is synced, so that the moments before each sync, and the end, have
    all states of the moments between; and there most is expected of them.
    """
    cuts = list(_moments(log))
    large = [index for index, (_, _, pending) in enumerate(cuts) if len(pending) > ALL_SUBSETS]
    share = dict.fromkeys(large, samples // max(1, len(large)))
    for index in rng.sample(large, samples % len(large)) if large else ():
        share[index] += 1
    latest: dict[bytes, State] = {}
    for index, (position, durable, pending) in enumerate(cuts):
        for kind, chosen in _chosen(pending, rng, share.get(index, 0), torn_each):
            _keep(latest, durable, chosen, position, kind)
    whole = Tree()
    for position, op in enumerate(log):
        whole.apply(op)
        if op.op not in ("mark", "sync", "sync folder"):
            _keep(latest, whole.copy(), (), position + 1, "prefix")
    yield from latest.values()


def _keep(latest: dict[bytes, State], durable: Tree, chosen: Sequence[Operation], position: int, kind: str) -> None:
    state = State(durable, tuple(chosen), position, kind)
    key = state.tree.key()
    known = latest.get(key)
    if known is None:
        latest[key] = state
    elif known.cut < position:
        latest[key] = replace(known, cut=position)


def _moments(log: Sequence[Operation]) -> Iterator[tuple[int, Tree, list[Operation]]]:
    """(number of the next operation, what is durable, what is not) before each sync and at the end."""
    durable, pending = Tree(), list[Operation]()
    for position, op in enumerate(log):
        if op.op == "sync":
            done = [p for p in pending if p.op in ("write", "truncate") and p.inode == op.inode]
        elif op.op == "sync folder":
            done = [p for p in pending if p.op in _NAMES and _folder_of(p) == op.path]
        else:
            if op.op != "mark":
                pending.append(op)
            continue
        if done:
            yield position, durable.copy(), list(pending)
        for p in done:
            durable.apply(p)
        pending = [p for p in pending if p not in done]
    yield len(log), durable, pending


def _folder_of(op: Operation) -> str:
    parent = str(Path(op.path2 or op.path).parent)
    return "" if parent == "." else parent


def _chosen(pending: list[Operation], rng: Random, samples: int, torn_each: int) -> Iterator[tuple[str, Sequence[Operation]]]:
    """Which of the ``pending`` operations arrived, or which parts of them."""
    if len(pending) <= ALL_SUBSETS:
        for count in range(len(pending) + 1):
            for chosen in combinations(pending, count):
                yield "subset", chosen
    else:
        yield "subset", ()
        for lost in pending:
            yield "subset", [op for op in pending if op is not lost]
        for _ in range(samples):
            share = rng.random()
            arrived = [op for op in pending if rng.random() < share]
            yield "sample", [part for op in arrived for part in (_torn(op, rng) if rng.random() < 0.2 else (op,))]
    for number, op in enumerate(pending):
        if op.op == "write" and len(op.data) > SECTOR:
            for _ in range(torn_each):
                yield "torn", [*pending[:number], *_torn(op, rng), *pending[number + 1 :]]
            yield "torn", [*pending[:number], *_torn(op, rng)]


def _torn(op: Operation, rng: Random) -> list[Operation]:
    """Some of the sectors of a write."""
    if op.op != "write":
        return [op]
    first = SECTOR - op.offset % SECTOR
    edges = [0, *range(first, len(op.data), SECTOR), len(op.data)]
    sectors = [replace(op, offset=op.offset + a, data=op.data[a:b]) for a, b in pairwise(edges)]
    return sorted(rng.sample(sectors, rng.randrange(len(sectors))), key=lambda sector: sector.offset)
