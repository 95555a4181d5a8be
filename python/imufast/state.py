"""Saved states of streams: a version, a checksum, plain settings as JSON, and the core's own bytes."""

from __future__ import annotations

import json
import zlib
from typing import Any

from imufast.errors import InputError

__all__ = ["pack", "unpack"]


def pack(version: bytes, plain: dict[str, Any], stream: bytes) -> bytes:
    """The bytes of a state."""
    text = json.dumps(plain).encode()
    body = len(text).to_bytes(8, "little") + text + stream
    return version + zlib.crc32(body).to_bytes(4, "little") + body


def unpack(version: bytes, state: bytes, name: str) -> tuple[dict[str, Any], bytes]:
    """What `pack` was given.

    Raises:
        InputError: not bytes, damaged, or of another version.
    """
    if not isinstance(state, bytes):
        raise InputError(f"state must be the bytes that {name}.state() gave, got {type(state).__name__}")
    start = len(version)
    checksum, body = int.from_bytes(state[start : start + 4], "little"), state[start + 4 :]
    try:
        if state[:start] != version or checksum != zlib.crc32(body):
            raise ValueError("damaged, or of another version")
        length = int.from_bytes(body[:8], "little")
        plain = json.loads(body[8 : 8 + length])
        if not isinstance(plain, dict):
            raise ValueError("damaged")
    except ValueError as error:
        raise InputError(f"state cannot be restored ({error}): give the bytes that {name}.state() gave") from None
    return plain, body[8 + length :]
