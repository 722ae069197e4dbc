"""Team: workers that run the same code at the same time, and exchange arrays without a scheduler between them.

A task of Dask takes some milliseconds of scheduler and client, as much as a product with the normal matrix of 800
grains.  Members of a team are one long task each, connected by sockets; an exchange takes a tenth of that.
"""

from __future__ import annotations

import pickle
import socket
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from grainmotion.model.task_map import not_shared

SECONDS_TO_MEET = 120
"""How long a member waits for the others to begin; they may have a task to end."""
SECONDS_TO_SEND = 1800
"""How long for what another one sends, which may compile its kernels meanwhile."""
LENGTH_BYTES = 8
Place = tuple[str, int]
"""Host and port on which a member listens."""
Item = TypeVar("Item")
Result = TypeVar("Result")
Number = TypeVar("Number", bound=np.generic)
_LISTENING = dict[str, socket.socket]()
_SENT = [0]


def sent_by_teams() -> int:
    """Bytes that this process has sent to other members of its teams."""
    return _SENT[0]


def listen(host: str, token: str) -> Place:
    """Listen on a free port of this process for the members of a team that know the ``token``."""
    _LISTENING[token] = socket.create_server((host, 0))
    return host, _LISTENING[token].getsockname()[1]


@dataclass(eq=False)
class Team:
    """One of the members, ``rank`` of ``size``, with a connection to each other one."""

    rank: int
    size: int
    others: dict[int, socket.socket] = field(default_factory=dict)

    @classmethod
    def meet(cls, rank: int, places: Sequence[Place], token: str) -> Team:
        """Connect to all members, each of which is called with the same places."""
        team, server = cls(rank, len(places)), _LISTENING.pop(token)
        try:
            for other in range(rank):
                team.others[other] = socket.create_connection(places[other], timeout=SECONDS_TO_MEET)
                team.others[other].sendall(token.encode() + rank.to_bytes(LENGTH_BYTES, "big"))
            server.settimeout(SECONDS_TO_MEET)
            while len(team.others) < team.size - 1:
                connection, _ = server.accept()
                known = _received(connection, len(token.encode()) + LENGTH_BYTES)
                if bytes(known[:-LENGTH_BYTES]) != token.encode():
                    connection.close()
                    continue
                team.others[int.from_bytes(known[-LENGTH_BYTES:], "big")] = connection
            for connection in team.others.values():
                connection.settimeout(SECONDS_TO_SEND)
                connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        except OSError:
            team.close()
            raise
        finally:
            server.close()
        return team

    def close(self) -> None:
        """Leave the team; the others' next exchange fails."""
        for connection in self.others.values():
            connection.close()
        self.others.clear()

    def exchange(self, parts: Callable[[int], NDArray[Number]]) -> dict[int, NDArray[Number]]:
        """Send ``parts(other)`` to each other member, and get theirs.

        All go through the pairs of members in the same order, so that nobody waits for one who waits.
        """
        found: dict[int, NDArray[Number]] = {}
        for other in sorted(self.others):
            mine = np.ascontiguousarray(parts(other))
            if self.rank < other:
                self._send(other, mine)
                found[other] = self._receive(other)
            else:
                found[other] = self._receive(other)
                self._send(other, mine)
        return found

    def call_each(self, function: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
        """A `task_map.Mapper`: each member makes its share of the calls."""
        every = list(items)
        with not_shared():
            own = [function(item) for item in every[self.rank :: self.size]]
        pickled = np.frombuffer(pickle.dumps(own, protocol=pickle.HIGHEST_PROTOCOL), np.uint8)
        shares: dict[int, list[Result]] = {self.rank: own}
        shares.update((m, pickle.loads(part.tobytes())) for m, part in self.exchange(lambda _: pickled).items())
        return [shares[k % self.size][k // self.size] for k in range(len(every))]

    def _send(self, other: int, array: NDArray[np.generic]) -> None:
        head = pickle.dumps((array.dtype, array.shape))
        self.others[other].sendall(len(head).to_bytes(LENGTH_BYTES, "big") + head)
        if array.size:
            self.others[other].sendall(array.reshape(-1).view(np.uint8).data)
        _SENT[0] += len(head) + array.nbytes

    def _receive(self, other: int) -> NDArray[Number]:
        connection = self.others[other]
        length = int.from_bytes(_received(connection, LENGTH_BYTES), "big")
        dtype, shape = pickle.loads(bytes(_received(connection, length)))
        array = np.empty(shape, dtype)
        if array.size:
            _fill(connection, array.reshape(-1).view(np.uint8).data)
        return array


def _received(connection: socket.socket, size: int) -> bytearray:
    """So many bytes."""
    found = bytearray(size)
    _fill(connection, memoryview(found))
    return found


def _fill(connection: socket.socket, view: memoryview) -> None:
    """Fill memory with what comes.

    Raises
    ------
    ConnectionError
        If the other member has left.
    """
    at = 0
    while at < len(view):
        count = connection.recv_into(view[at:])
        if not count:
            raise ConnectionError("a worker that tracked the same state has left")
        at += count
