"""Seeded changes to bytes and text, as faulty cards, interrupted copies and hostile senders make them."""

import struct
from typing import Literal

import numpy as np


def flip_bits(data: bytes, rng: np.random.Generator) -> bytes:
    changed = bytearray(data)
    for place in rng.integers(0, len(data), rng.integers(1, 20)):
        changed[place] ^= 1 << int(rng.integers(8))
    return bytes(changed)


def zero_run(data: bytes, rng: np.random.Generator) -> bytes:
    start, length = int(rng.integers(len(data))), int(rng.integers(1, 600))
    return data[:start] + bytes(len(data[start : start + length])) + data[start + length :]


def damage_block(data: bytes, rng: np.random.Generator) -> bytes:
    """Zero 400 bytes in the middle half, away from headers and directories."""
    start = int(rng.integers(len(data) // 4, 3 * len(data) // 4))
    return data[:start] + bytes(400) + data[start + 400 :]


_TIFF_TAGS = (254, 256, 257, 258, 259, 262, 266, 273, 274, 277, 278, 279, 284, 317, 322, 323, 324, 325, 338, 339, 347)
_TIFF_NUMBERS = (0, 1, 2, 3, 5, 8, 16, 32, 64, 255, 65535, 1 << 31)
_TIFF_FIELDS = (("<H", 0, _TIFF_TAGS), ("<H", 2, range(14)), ("<I", 4, _TIFF_NUMBERS), ("<I", 8, _TIFF_NUMBERS))
"""Tag, type, count and value of a directory's entry: form, offset, and what they become."""


def change_directory(data: bytes, rng: np.random.Generator) -> bytes:
    """Change tag, type, count or value in one or two entries of a little-endian TIFF's first directory."""
    changed = bytearray(data)
    (first,) = struct.unpack_from("<I", changed, 4)
    (count,) = struct.unpack_from("<H", changed, first)
    for _ in range(rng.integers(1, 3)):
        entry = first + 2 + 12 * int(rng.integers(count))
        form, offset, numbers = _TIFF_FIELDS[rng.integers(len(_TIFF_FIELDS))]
        struct.pack_into(form, changed, entry + offset, int(rng.choice(numbers)))
    return bytes(changed)


def truncate(data: bytes, rng: np.random.Generator) -> bytes:
    return data[: int(rng.integers(len(data)))]


def extreme_integer(data: bytes, rng: np.random.Generator) -> bytes:
    """Overwrite two or four bytes, most often near the start, by a number that headers rarely hold."""
    reach = len(data) if rng.random() < 0.3 else min(len(data), 300)
    start, size = int(rng.integers(reach)), int(rng.choice([2, 4]))
    number = int(rng.choice([0, 1, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0xFFFFFFFF])) & ((1 << 8 * size) - 1)
    order: Literal["big", "little"] = "big" if rng.random() < 0.5 else "little"
    return (data[:start] + number.to_bytes(size, order) + data[start + size :])[: len(data)]


def repeat_slice(data: bytes, rng: np.random.Generator) -> bytes:
    start, length = int(rng.integers(len(data))), int(rng.integers(1, 200))
    return data[: start + length] + data[start : start + length] * int(rng.integers(1, 50)) + data[start + length :]


MUTATORS = (flip_bits, zero_run, truncate, extreme_integer, extreme_integer, repeat_slice)


def mutated(data: bytes, rng: np.random.Generator) -> bytes:
    """``data`` after one to three changes."""
    for _ in range(rng.integers(1, 4)):
        if data:
            data = MUTATORS[rng.integers(len(MUTATORS))](data, rng)
    return data


WORDS = ("nan", "-1", "0", "1e999", "true", "'text'", "[]", "{}", "99999999999999999999", "2024-01-01", '"\\u0000"')


def mutated_text(text: str, rng: np.random.Generator, separator: str = "=") -> bytes:
    """Replace values of a file of keys and values; repeat or shuffle its lines, or damage its bytes."""
    lines = text.splitlines()
    for _ in range(rng.integers(1, 4)):
        place, choice = int(rng.integers(len(lines))), int(rng.integers(5))
        key = lines[place].partition(separator)[0]
        if choice == 0:
            lines[place] = f"{key}{separator} {rng.choice(WORDS)}"
        elif choice == 1:
            lines.insert(place, lines[place])
        elif choice == 2:
            lines[place] = lines[place].replace("_", "-")
        elif choice == 3:
            rng.shuffle(lines)
        else:
            lines[place] = f"{key}{separator} {'[' * int(rng.integers(1, 5000))}"
    data = "\n".join(lines).encode()
    return mutated(data, rng) if rng.random() < 0.3 else data
