"""An OLE compound file (MS-CFB, version 3) written from its specification: the container of Zeiss's files."""

from __future__ import annotations

import struct
from pathlib import Path

SECTOR, MINI_SECTOR, MINI_LIMIT = 512, 64, 4096
FREE, END, FAT_SECTOR, NO_ENTRY = 0xFFFFFFFF, 0xFFFFFFFE, 0xFFFFFFFD, 0xFFFFFFFF


def write_compound_file(path: str | Path, streams: dict[str, bytes]) -> None:
    """Write ``streams``, by paths such as ``"ImageInfo/Angles"``; short ones lie in the mini stream."""
    entries = _entries(streams)
    sectors = bytearray()
    fat: list[int] = []
    mini = bytearray()
    mini_fat: list[int] = []
    for entry in entries:
        data = entry["data"]
        if len(data) >= MINI_LIMIT:
            entry["start"] = _append(sectors, fat, data, SECTOR)
        elif data:
            entry["start"] = _append(mini, mini_fat, data, MINI_SECTOR)
    root = entries[0]
    root["start"], root["size"] = _append(sectors, fat, bytes(mini), SECTOR), len(mini)
    mini_start = _append(sectors, fat, struct.pack(f"<{len(mini_fat)}I", *mini_fat), SECTOR, FREE)
    directory = b"".join(_packed(entry) for entry in entries)
    directory += _packed(_entry("", 0)) * (-len(entries) % 4)
    directory_start = _append(sectors, fat, directory, SECTOR)
    fat_sectors = 1
    while len(fat) + fat_sectors > fat_sectors * SECTOR // 4:
        fat_sectors += 1
    places = list(range(len(fat), len(fat) + fat_sectors))
    fat += [FAT_SECTOR] * fat_sectors
    fat += [FREE] * (fat_sectors * SECTOR // 4 - len(fat))
    assert fat_sectors <= 109, "a file of this size needs DIFAT sectors"
    header = struct.pack("<8s16sHHHHH6x", bytes.fromhex("d0cf11e0a1b11ae1"), b"", 0x3E, 3, 0xFFFE, 9, 6)
    mini_sectors = -(-len(mini_fat) * 4 // SECTOR)
    header += struct.pack(
        "<IIIIIIIII", 0, fat_sectors, directory_start, 0, MINI_LIMIT, mini_start, mini_sectors, END, 0
    )
    header += struct.pack("<109I", *places, *[FREE] * (109 - fat_sectors))
    Path(path).write_bytes(header + bytes(sectors) + struct.pack(f"<{len(fat)}I", *fat))


def _append(sectors: bytearray, chain: list[int], data: bytes, size: int, fill: int = 0) -> int:
    """Append data in whole sectors, chained one after the other; the number of the first."""
    if not data:
        return END
    first, count = len(chain), -(-len(data) // size)
    sectors += data + bytes([fill & 0xFF]) * (count * size - len(data))
    chain += [*range(first + 1, first + count), END]
    return first


def _entry(name: str, kind: int, data: bytes = b"") -> dict:
    links = {"left": NO_ENTRY, "right": NO_ENTRY, "child": NO_ENTRY}
    return {"name": name, "kind": kind, "data": data, "size": len(data), "start": END if kind else 0, **links}


def _entries(streams: dict[str, bytes]) -> list[dict]:
    """Root, storages (1) and streams (2), with the links of each storage's tree."""
    entries, places = [_entry("Root Entry", 5)], {"": 0}
    children: dict[str, list[str]] = {"": []}
    for path, data in streams.items():
        parts = path.split("/")
        for depth in range(1, len(parts) + 1):
            full, parent = "/".join(parts[:depth]), "/".join(parts[: depth - 1])
            if full in places:
                continue
            leaf = depth == len(parts)
            places[full] = len(entries)
            children[parent].append(full)
            children.setdefault(full, [])
            entries.append(_entry(parts[depth - 1], 2 if leaf else 1, data if leaf else b""))
    for parent, members in children.items():
        names = {member: member.split("/")[-1] for member in members}
        order = sorted(members, key=lambda m: (len(names[m]), names[m].upper()))
        entries[places[parent]]["child"] = _tree(entries, [places[m] for m in order])
    return entries


def _tree(entries: list[dict], members: list[int]) -> int:
    """A balanced binary tree of directory entries, and its root."""
    if not members:
        return NO_ENTRY
    middle = len(members) // 2
    entry = entries[members[middle]]
    entry["left"], entry["right"] = _tree(entries, members[:middle]), _tree(entries, members[middle + 1 :])
    return members[middle]


def _packed(entry: dict) -> bytes:
    name = entry["name"].encode("utf-16-le") + b"\0\0" if entry["kind"] else b""
    links = entry["left"], entry["right"], entry["child"]
    head = struct.pack("<64sHBBIII", name, len(name), entry["kind"], 1, *links)
    return head + bytes(16 + 4 + 8 + 8) + struct.pack("<IQ", entry["start"], entry["size"])
