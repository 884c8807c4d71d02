# SPDX-License-Identifier: Apache-2.0
"""The records of an MCAP file in any state, at any level: whole, cut off or damaged.

Reading goes from record to record by their lengths. Where that leads nowhere, it goes on at the
next chunk whose content matches its checksum, or that can be read exactly to its end if it has
none. So it finds every whole chunk that the index of the file names, also if the index is damaged
or bytes were inserted. Behind messages outside of chunks, which have no checksums, it goes on where
several messages follow one another.

https://mcap.dev/spec has the layouts.
"""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Callable, Collection, Iterator
from io import BytesIO
from typing import IO, Any

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    ChunkIndex,
    Header,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)

from .bag import BagError, Message

HEAD = struct.Struct("<BQ")  # opcode and length of a record
_MESSAGE = struct.Struct("<HIQQ")  # channel, number, log time, publish time; the data follow
_CHUNK = struct.Struct("<QQQII")  # times, size, checksum, length of the compression's name
_SIZE = struct.Struct("<Q")
_PLACE = struct.Struct("<QQ")  # an entry in the index of a chunk: log time, place in its content
_PLACES = 6  # bytes in front of the entries: the channel and their length
_KINDS: dict[int, Any] = {
    Opcode.HEADER: Header, Opcode.SCHEMA: Schema, Opcode.CHANNEL: Channel,
    Opcode.STATISTICS: Statistics, Opcode.METADATA: Metadata, Opcode.CHUNK_INDEX: ChunkIndex,
    Opcode.METADATA_INDEX: MetadataIndex,
}  # fmt: skip
_PRIVATE = 0x80  # first kind of record that anybody may add
# A record of less than 4 GiB: the upper half of its length is zero.
_CHUNK_HEAD = re.compile(rb"\x06(?=.{4}\0{4})", re.DOTALL)
_ANY_HEAD = re.compile(rb"[\x05\x06](?=.{4}\0{4})", re.DOTALL)
_BLOCK = 2**20
_CHAIN = 8  # records in a row that are taken for no accident


class Content:
    """The bytes of a file, read in blocks.

    end: of its records. largest: record or uncompressed chunk that is read [B]. chunks: places that
    the index of the file names.
    """

    def __init__(self, file: IO[bytes], end: int, largest: int):
        self.end, self.largest = end, largest
        self.chunks: set[int] = set()
        self._file, self._begin, self._block = file, 0, b""

    def at(self, position: int, size: int) -> bytes:
        """Return the bytes from a position on, fewer at the end."""
        offset = position - self._begin
        if offset < 0 or offset + size > len(self._block):
            self._file.seek(position)
            self._block, self._begin, offset = self._file.read(max(size, _BLOCK)), position, 0
        return self._block[offset : offset + min(size, max(0, self.end - position))]

    def head(self, position: int) -> tuple[int, int]:
        """Return opcode and end of the record at a position; (0, 0) if none can begin there."""
        head = self.at(position, HEAD.size)
        if len(head) < HEAD.size:
            return 0, 0
        opcode, length = HEAD.unpack(head)
        end = position + HEAD.size + length
        return (opcode, end) if opcode and end <= self.end else (0, 0)

    def leads_on(self, position: int) -> bool:
        """Return whether a record may begin at a position, or the file ends there."""
        return (
            position == self.end or position in self.chunks or self.head(position) != (0, 0)
        )


def records(
    content: Content, begin: int, kinds: Collection[int], known: Callable[[int], bool]
) -> Iterator[Any]:
    """Yield the records of these kinds, of chunks their content; a BagError where one is damaged.

    known: whether a channel is declared.
    """
    position, loose = begin, True  # whether messages may stand outside of chunks from here on
    while position < content.end:
        opcode, end = content.head(position)
        if opcode in (Opcode.CHUNK, Opcode.MESSAGE):
            loose = opcode == Opcode.MESSAGE
        is_broken = not (opcode and content.leads_on(end))
        found: list[Any] = []
        is_sure = False
        if Opcode.CHUNK in kinds and (opcode == Opcode.CHUNK or position in content.chunks):
            found, is_sure, end = _chunk(content, position, end, is_broken)
        elif opcode in kinds:
            found = _read(content, position, opcode, end)
        if is_sure or not is_broken:
            if Opcode.DATA_END < opcode < _PRIVATE:
                yield BagError(f"a record of no known kind at byte {position}")
            yield from found
            position = end
            continue
        place = _next(content, position + 1, known if loose else None)
        is_whole = bool(found) and end <= place  # what follows it is damaged, or else its length
        yield from found if is_whole else (each for each in found if isinstance(each, BagError))
        begin, position = end if is_whole else position, place
        if position > begin:
            until = "on" if place == content.end else f"to byte {place}"
            yield BagError(f"cut off or damaged from byte {begin} {until}")


def _read(content: Content, position: int, opcode: int, end: int) -> list[Any]:
    """Return a record outside of chunks, or a BagError."""
    try:
        body = _body(content, position, end)
        if opcode == Opcode.MESSAGE:
            return [_message(body, 0, len(body))]
        return [_KINDS[opcode].read(ReadDataStream(BytesIO(body)))]
    except Exception as error:  # whatever a decoder stumbles over
        return [BagError(f"a record at byte {position} is damaged: {error}")]


def _chunk(
    content: Content, position: int, end: int, is_broken: bool
) -> tuple[list[Any], bool, int]:
    """Return what a chunk yields, whether its checksum is right, and its end.

    It states its length twice. is_broken: whether the first one, that of the record, leads nowhere.
    """
    head = content.at(position + HEAD.size, _CHUNK.size + len("zstd") + _SIZE.size)
    ends = [end] if end else []
    if len(head) >= _CHUNK.size + _SIZE.size and (named := _CHUNK.unpack_from(head)[-1]) <= 4:
        size = head[_CHUNK.size + named :][: _SIZE.size].ljust(_SIZE.size, b"\xff")
        own = position + HEAD.size + _CHUNK.size + named + _SIZE.size + _SIZE.unpack(size)[0]
        if own <= content.end:
            ends.insert(0 if is_broken else len(ends), own)
    told = "it is cut off"
    for place in dict.fromkeys(ends):
        try:
            found, is_sure = unpacked(_body(content, position, place), content.largest)
        except Exception as error:  # whatever a decompression stumbles over
            told = str(error)
        else:
            if is_sure or place == end:
                return found, is_sure, place
    return [BagError(f"a chunk at byte {position} is damaged: {told}")], False, end


def _body(content: Content, position: int, end: int) -> bytes:
    length = end - position - HEAD.size
    if length > content.largest:
        raise BagError(f"{length} bytes are too many for one record")
    return content.at(position + HEAD.size, length)


def unpacked(body: bytes, largest: int) -> tuple[list[Any], bool]:
    """Return the declarations and messages of a chunk, and whether its checksum says so.

    The last one is a BagError if the content breaks off. Raises as `unpacked_bytes` does.
    """
    data, is_sure = unpacked_bytes(body, largest)
    return _inner(data), is_sure


def unpacked_bytes(body: bytes, largest: int) -> tuple[bytes, bool]:
    """Return the content of a chunk, and whether its checksum says so.

    largest: size of its content that is accepted [B]. A checksum of 0 means that none was given.
    Raises ValueError, BagError, or what the decompression raises.
    """
    *_, size, checksum, named = _CHUNK.unpack_from(body)
    at = _CHUNK.size + named
    compression, (length,) = body[_CHUNK.size : at].decode(), _SIZE.unpack_from(body, at)
    rest = body[at + _SIZE.size :]
    if not checksum and len(rest) < length:
        raise ValueError("it is shorter than it states")
    told: Exception = ValueError("its content does not match its checksum")
    for packed in dict.fromkeys((rest[:length], rest)):  # of two lengths one may be damaged
        try:
            data = _decompressed(packed, compression, size, largest)
        except Exception as error:  # whatever a decompression stumbles over
            told = error
            continue
        if not checksum or zlib.crc32(data) == checksum:
            return data, bool(checksum)
    raise told


def _decompressed(packed: bytes, compression: str, size: int, largest: int) -> bytes:
    """Return the content; size: as the chunk states it, for a compression that has none."""
    if compression == "":
        return packed
    if compression == "lz4":
        data = lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=largest + 1)
        size = len(data)
    elif compression == "zstd":
        told = zstandard.frame_content_size(packed)
        size = told if told >= 0 else size
    else:
        raise BagError(f"its compression {compression!r} is not known here")
    if size > largest:
        raise BagError(f"more than {largest} bytes are too many for one")
    return data if compression == "lz4" else zstandard.decompress(packed, size)


def _message(data: bytes, begin: int, end: int) -> Message:
    """Return the message whose record has this content."""
    channel, number, logged, sent = _MESSAGE.unpack_from(data, begin)
    return Message(channel, logged, sent, number, data[begin + _MESSAGE.size : end])


def indexed(content: Content, chunk: ChunkIndex, channels: Collection[int]) -> Iterator[Message]:
    """Yield the messages of channels that the index of a chunk names, in the order of the file.

    No other message is looked at. Raises BagError where the chunk or its index is damaged.
    """
    position, places = chunk.chunk_start_offset, []
    try:
        _, end = content.head(position)
        data, _ = unpacked_bytes(_body(content, position, end), content.largest)
        for channel in channels:
            begin = chunk.message_index_offsets[channel]
            body = _body(content, begin, content.head(begin)[1])
            places += [place for _, place in _PLACE.iter_unpack(body[_PLACES:])]
        for place in sorted(places):
            start, (_, length) = place + HEAD.size, HEAD.unpack_from(data, place)
            yield _message(data, start, start + length)
    except Exception as error:  # whatever a decompression stumbles over
        raise BagError(f"a chunk at byte {position} is damaged: {error}") from None


def _inner(data: bytes) -> list[Any]:
    found: list[Any] = []
    position, end = 0, len(data)
    head = HEAD.unpack_from
    try:
        while position < end:
            opcode, length = head(data, position)
            following = position + HEAD.size + length
            if following > end:
                raise ValueError("it breaks off in a record")
            if opcode == Opcode.MESSAGE:
                found.append(_message(data, position + HEAD.size, following))
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                body = data[position + HEAD.size : following]
                found.append(_KINDS[opcode].read(ReadDataStream(BytesIO(body))))
            position = following
    except Exception as error:  # whatever a decoder stumbles over
        found.append(BagError(f"a chunk is damaged: {error}"))
    return found


def _next(content: Content, position: int, known: Callable[[int], bool] | None) -> int:
    """Return where reading can go on, the end of the file without such a place.

    That is a whole chunk, which the index names or which is found. known: whether a channel is
    declared; also look for messages outside of chunks.
    """
    wanted = _CHUNK_HEAD if known is None else _ANY_HEAD
    named = (place for place in sorted(content.chunks) if position <= place < content.end)
    last = next((place for place in named if _chunk(content, place, 0, True)[1]), content.end)
    while position < last:
        block = content.at(position, _BLOCK)
        for match in wanted.finditer(block):
            place = position + match.start()
            if place >= last:
                return last
            if block[match.start()] == Opcode.CHUNK:
                if _is_whole(content, place):
                    return place
            elif known is not None and _is_chain(content, place, known):
                return place
        position += max(1, len(block) - HEAD.size)
    return last


def _is_whole(content: Content, position: int) -> bool:
    """Return whether a whole chunk begins here."""
    opcode, end = content.head(position)
    head = content.at(position + HEAD.size, _CHUNK.size)
    if not opcode or len(head) < _CHUNK.size or _CHUNK.unpack(head)[-1] > len("zstd"):
        return False
    try:
        found, _ = unpacked(_body(content, position, end), content.largest)
    except Exception:  # whatever its decompression stumbles over: it is no chunk
        return False
    return not any(isinstance(each, BagError) for each in found)


def _is_chain(content: Content, position: int, known: Callable[[int], bool]) -> bool:
    """Return whether a message of a known channel begins here, and further records follow it."""
    (channel,) = struct.unpack("<H", content.at(position + HEAD.size, 2).ljust(2, b"\xff"))
    if not known(channel):
        return False
    for _ in range(_CHAIN):
        opcode, end = content.head(position)
        if not 0 < opcode <= Opcode.DATA_END:
            return False
        position = end
        if position == content.end:
            return True
    return True
