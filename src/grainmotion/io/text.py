"""Text files as editors and spreadsheets leave them: with or without a byte order mark, with any ends of lines."""

from __future__ import annotations

import codecs
from pathlib import Path

from grainmotion.errors import InputError
from grainmotion.io.files import checked_file

_UTF16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
_SPREADSHEETS = (b"PK\x03\x04", b"\xd0\xcf\x11\xe0")
_SAVE_AS = "save it as UTF-8: in Notepad or Excel, 'Save as', encoding UTF-8"


def read_text(path: str | Path) -> str:
    """The text of a UTF-8 file without its byte order mark, lines ending in ``\\n``; other encodings are refused."""
    path = checked_file(path)
    data = path.read_bytes()
    if data.startswith(_SPREADSHEETS):
        raise InputError(str(path), "a spreadsheet or an archive, no text", "save the sheet as CSV")
    if data.startswith(_UTF16) or b"\0" in data[:200]:
        kind = "text encoded as UTF-16" if data.startswith(_UTF16) else "no text: it holds zero bytes"
        raise InputError(str(path), kind, _SAVE_AS)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        fact = f"line {line} is no UTF-8 (byte {data[error.start]:#04x})"
        raise InputError(str(path), fact, _SAVE_AS) from error
    return text.replace("\r\n", "\n").replace("\r", "\n")
