"""What `compress` packed (.Z), as older SP3 files are kept; Python's library has no reader for it.

Welch's codes of 9 to 16 bits, the least significant bit first, in groups of eight codes of one width.
"""

from __future__ import annotations

_MAGIC = b"\x1f\x9d"
_CLEAR, _FIRST_WIDTH, _WIDEST = 256, 9, 16


def is_compressed(data: bytes) -> bool:
    """Tell whether data begin as `compress` begins them."""
    return data[:2] == _MAGIC


def uncompressed(data: bytes, most: int) -> bytes:
    """Return what was packed. Raises ValueError for damaged data, or more than so many bytes."""
    if len(data) < 3 or not _FIRST_WIDTH <= data[2] & 0x1F <= _WIDEST:
        raise ValueError("its head is not whole")
    widest, clears = data[2] & 0x1F, bool(data[2] & 0x80)
    table = [bytes([k]) for k in range(256)] + ([b""] if clears else [])
    out: list[bytes] = []
    size, width, at, before = 0, _FIRST_WIDTH, 24, b""
    group = at
    while at + width <= 8 * len(data):
        if len(table) >= 1 << width and width < widest:
            at = group + -(-(at - group) // (8 * width)) * 8 * width
            group, width = at, width + 1
            continue
        code = (int.from_bytes(data[at >> 3 : (at >> 3) + 4], "little") >> (at & 7)) & ((1 << width) - 1)
        at += width
        if clears and code == _CLEAR:
            at = group + -(-(at - group) // (8 * width)) * 8 * width
            del table[_CLEAR + 1 :]
            group, width, before = at, _FIRST_WIDTH, b""
            continue
        if code < len(table):
            entry = table[code]
        elif code == len(table) and before:
            entry = before + before[:1]
        else:
            raise ValueError(f"code {code} at byte {at >> 3} stands for nothing")
        out.append(entry)
        size += len(entry)
        if size > most:
            raise ValueError(f"it unpacks to more than {most // 2**20} MiB")
        if before and len(table) < 1 << widest:
            table.append(before + entry[:1])
        before = entry
    return b"".join(out)
