"""The boxes of a JPEG 2000 file (ISO/IEC 15444-1, annex I), checked before GDAL reads them."""

import struct
from typing import BinaryIO

HOLDING = (b"jp2h", b"res ", b"asoc", b"uinf")  # kinds of boxes that hold boxes
MAX_BOXES = 100_000  # boxes


def endless(file: BinaryIO) -> bool:
    """Whether GDAL would read the boxes of a file for ever, or far too long.

    Only the last box may declare that it reaches to the end of the file. Where a box inside another one does, GDAL
    reads it again and again. A file of more than `MAX_BOXES` boxes counts as endless, too.
    """
    unread, seen = [(0, file.seek(0, 2), True)], 0
    while unread:
        place, end, outermost = unread.pop()
        while place + 8 <= end:
            file.seek(place)
            length, kind = struct.unpack(">I4s", file.read(8))
            head = 8
            if length == 1 and place + 16 <= end:
                length, head = *struct.unpack(">Q", file.read(8)), 16
            seen += 1
            if (length == 0 and not outermost) or seen > MAX_BOXES:
                return True
            if length < head:  # the last one, or not a box
                break
            if kind in HOLDING:
                unread.append((place + head, min(place + length, end), False))
            place += length
    return False
