"""Damage for the readers: what a bad disk, a broken exporter or a hostile author makes of a good file."""

import copy
import json
import random
import re
import struct
from typing import Any

WORDS = [b"nan", b"inf", b"-inf", b"1e999", b"-1", b"0", b"", b"18446744073709551616", b"9" * 400, b"1e-400", b"0x1p3"]
WORDS += [b"null", b"true", b"[]", b"{}", b'"', b"\\u0000", b"\x00", b"\xff\xfe", "ü\u2028".encode(), b"list", b"uchar"]
WORDS += [b"vertex", b"element", b"property", b"end_header", b"9" * 5000, b"[" * 3000, b"999999999", b"4294967295"]
INTEGERS = [0, 1, 2, 127, 128, 255, 2**15, 2**16 - 1, 2**31 - 1, 2**31, 2**32 - 1, 2**40, 2**63 - 1, 2**63, 2**64 - 1]
FLOATS = [0.0, -0.0, 1e308, -1e308, 1e-320, float("nan"), float("inf"), float("-inf"), 3.4e38, 1e39]
VALUES: list[Any] = [None, True, "", "x", "../../x", "\x00", "1", -1, 0, 1, 0.5, 1e308, 10**30, [], {}, [[]], [1]]
VALUES += [float("nan"), float("inf"), -1e-300, "ü \u2028\ud800", {"a": 1}, 10**400, 2**63, "A" * 300]
VALUES += [[0] * 16, [[0] * 4] * 4]


def mutate(seeds: list[bytes], chance: random.Random) -> bytes:
    """One of the seeds with one to a few damages."""
    data = chance.choice(seeds)
    if data[:1] in (b"{", b"[") and chance.random() < 0.8:
        data = mutate_json(data, chance)
        if chance.random() < 0.9:
            return data
    for _ in range(chance.choice((1, 1, 1, 2, 3, 6))):
        data = chance.choice(DAMAGES)(data, seeds, chance)
    return data[: 1 << 20]


def mutate_json(data: bytes, chance: random.Random) -> bytes:
    """Values of a JSON document replaced, dropped, doubled; it stays a JSON document."""
    if data.count(b"\n") > 1:  # a document per line
        lines = data.split(b"\n")
        i = chance.randrange(len(lines) - 1)
        return b"\n".join([*lines[:i], mutate_json(lines[i], chance), *lines[i + 1 :]])
    content = [json.loads(data)]  # in a list, so that the root can be replaced too
    for _ in range(chance.choice((1, 1, 2, 4))):
        holders = list(_holders(content))
        holder = chance.choice(holders)
        keys = list(holder) if isinstance(holder, dict) else list(range(len(holder)))
        key = chance.choice(keys)
        match chance.randrange(4):
            case 0 if len(content) > 0 and holder is not content:
                del holder[key]
            case 1 if isinstance(holder, list) and holder is not content:
                holder.insert(key, json.loads(json.dumps(holder[key])))
            case _:
                holder[key] = copy.deepcopy(chance.choice(VALUES))
    return json.dumps(content[0]).encode()


def _holders(value: Any):
    """All lists and objects that hold something, the outermost first."""
    if isinstance(value, (dict, list)) and value:
        yield value
        for inner in value.values() if isinstance(value, dict) else value:
            yield from _holders(inner)


def _cut(data, seeds, chance):
    return data[: chance.randrange(len(data) + 1)]


def _flip_bits(data, seeds, chance):
    changed = bytearray(data)
    for _ in range(chance.choice((1, 1, 2, 8, 64)) if data else 0):
        changed[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
    return bytes(changed)


def _put_number(data, seeds, chance):
    if chance.random() < 0.6:
        number = chance.choice(INTEGERS)
        size = chance.choice((1, 2, 4, 8))
        new = (number % 256**size).to_bytes(size, chance.choice(("little", "little", "big")))
    else:
        new = struct.pack(chance.choice(("<d", "<f", ">f")), min(max(chance.choice(FLOATS), -3e38), 3e38))
    at = chance.randrange(len(data) + 1)
    at -= chance.choice((0, at % 4, at % 8))
    return data[:at] + new + data[at + len(new) :]


def _replace_number(data, seeds, chance):
    """A number that is written out becomes a word."""
    numbers = list(re.finditer(rb"-?\d+(\.\d+)?(e-?\d+)?", data[:20_000]))
    if not numbers:
        return data
    number = chance.choice(numbers)
    return data[: number.start()] + chance.choice(WORDS) + data[number.end() :]


def _insert(data, seeds, chance):
    at = chance.randrange(len(data) + 1)
    return data[:at] + chance.choice(WORDS) + data[at:]


def _delete(data, seeds, chance):
    at = chance.randrange(len(data) + 1)
    return data[:at] + data[at + chance.choice((1, 2, 4, 8, 64, 1000)) :]


def _repeat(data, seeds, chance):
    at, size = chance.randrange(len(data) + 1), chance.choice((1, 8, 40, 200))
    return data[: at + size] + data[at : at + size] * chance.choice((1, 2, 50)) + data[at + size :]


def _splice(data, seeds, chance):
    other = chance.choice(seeds)
    return data[: chance.randrange(len(data) + 1)] + other[chance.randrange(len(other) + 1) :]


def _drop_line(data, seeds, chance):
    lines = data.split(b"\n")
    del lines[chance.randrange(len(lines))]
    return b"\n".join(lines)


def _swap_lines(data, seeds, chance):
    lines = data.split(b"\n")
    i, j = chance.randrange(len(lines)), chance.randrange(len(lines))
    lines[i], lines[j] = lines[j], lines[i]
    return b"\n".join(lines)


DAMAGES = [_cut, _flip_bits, _put_number, _replace_number, _insert, _delete, _repeat, _splice, _drop_line, _swap_lines]
