"""Plain tar files: members are written byte for byte as `webdataset.TarWriter` does, and found fast.

Not through webdataset itself: importing it loads torch (2.8 s and 220 MB in each worker process), and it
takes 75 us a member where this takes 8. A test holds the two writers' files to be equal.
"""

from __future__ import annotations

import tarfile
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from geoprior.errors import DataError

BLOCK = 512
MAKE_AGAIN = "run the stage that made it again (`geoprior generate`, `geoprior demos`)"
REMEDY = f"look closer with `geoprior shards verify PATH`, or delete it and {MAKE_AGAIN}"
LONGEST_NAME = 100
_OWNER = "geoprior"
_MODE = 0o444
_END = bytes(2 * BLOCK)


class Member(NamedTuple):
    """One file in a tar: its name, where its content begins, and how many bytes it has."""

    name: str
    offset: int
    size: int


class ArchiveWriter:
    """Writes members one after the other; the same members give the same bytes.

    Args:
        write: Takes bytes, in order.
    """

    def __init__(self, write: Callable[[bytes | memoryview], object]) -> None:
        self._write = write
        self._size = 0

    def add(self, name: str, content: bytes) -> None:
        """Write one member.

        Raises:
            ValueError: The name is not ASCII or has more than 100 characters.
        """
        padding = bytes(-len(content) % BLOCK)
        self.add_blocks(member_header(name, len(content)) + content + padding)

    def add_blocks(self, members: bytes | memoryview) -> None:
        """Write whole members: headers, contents and padding."""
        self._write(members)
        self._size += len(members)

    def close(self) -> None:
        """Write the end of the archive."""
        self._size += len(_END)
        self._write(_END + bytes(-self._size % tarfile.RECORDSIZE))


def read_members(path: Path) -> list[Member]:
    """Find every regular file in a tar by its headers alone (2 us each).

    Raises:
        DataError: It is missing, not a tar, cut off in a member, or cut off between two members.
    """
    try:
        with path.open("rb", buffering=1 << 16) as file:
            size = file.seek(0, 2)
            file.seek(0)
            members, end = _walk(file.read, file.seek, size)
    except FileNotFoundError as error:
        raise DataError(f"{path}: no such file", REMEDY) from error
    except _ForeignError:
        members, end = _walk_foreign(path)
    except (OSError, ValueError) as error:
        raise DataError(f"{path}: {error}", REMEDY) from error
    _require_end(path, end)
    return members


class _ForeignError(Exception):
    """A header that the fast way does not know: GNU or PAX extensions, folders, links."""


def _walk(read: Callable[[int], bytes], seek: Callable[[int], int], size: int) -> tuple[list[Member], int]:
    members: list[Member] = []
    offset = 0
    while (header := read(BLOCK)) and header[0]:
        if len(header) < BLOCK:
            raise ValueError(f"cut off in the header of the member at byte {offset}")
        if header[257:262] != b"ustar":
            raise ValueError(f"not a tar, or damaged: no member begins at byte {offset}")
        if header[156:157] not in b"0\0" or header[345] or header[124] & 0x80:
            raise _ForeignError
        member = Member(header[:100].split(b"\0", 1)[0].decode(), offset + BLOCK, _size(header, offset))
        offset = _after(member)
        if offset > size:
            raise ValueError(f"cut off in {member.name}: it should reach byte {offset}, the file has {size}")
        members.append(member)
        seek(offset)
    return members, offset


def _size(header: bytes, offset: int) -> int:
    digits = header[124:136].strip(b"\0 ")
    if not digits.isdigit():
        raise ValueError(f"damaged: the size of the member at byte {offset} is {digits!r}")
    return int(digits, 8)


def _walk_foreign(path: Path) -> tuple[list[Member], int]:
    try:
        with tarfile.open(path, "r:") as archive:
            members: list[Member] = []
            last = -1
            for info in archive:
                if info.size < 0 or info.offset <= last:
                    raise DataError(f"{path}: damaged: the size of {info.name!r} is {info.size}", REMEDY)
                last = info.offset
                if info.isreg():
                    members.append(Member(info.name, info.offset_data, info.size))
            return members, archive.offset
    except tarfile.TarError as error:
        raise DataError(f"{path}: not a tar, or damaged ({error})", REMEDY) from error


def _require_end(path: Path, end: int) -> None:
    """A tar cut between two members looks whole but for its missing end mark."""
    with path.open("rb") as file:
        file.seek(end)
        if file.read(BLOCK) != bytes(BLOCK):
            raise DataError(f"{path}: cut off after byte {end}: the tar's end mark is missing", REMEDY)


def _after(member: Member) -> int:
    return member.offset + (member.size + BLOCK - 1) // BLOCK * BLOCK


def _template() -> bytes:
    info = tarfile.TarInfo("")
    info.mode, info.uname, info.gname = _MODE, _OWNER, _OWNER
    return info.tobuf(tarfile.USTAR_FORMAT)


_BLANK = _template()
_BLANK_SUM = sum(_BLANK[100:124]) + sum(_BLANK[136:148]) + 8 * ord(" ") + sum(_BLANK[156:])


def member_header(name: str, size: int) -> bytes:
    """The 512 bytes before a member's content.

    Raises:
        ValueError: The name is not ASCII or has more than 100 characters.
    """
    encoded, digits = name.encode("ascii"), b"%011o\0" % size
    if len(encoded) > LONGEST_NAME:
        raise ValueError(f"the member name {name!r} is longer than {LONGEST_NAME} characters")
    checksum = b"%06o\0 " % (_BLANK_SUM + sum(encoded) + sum(digits))
    return b"".join(
        (encoded.ljust(100, b"\0"), _BLANK[100:124], digits, _BLANK[136:148], checksum, _BLANK[156:])
    )
