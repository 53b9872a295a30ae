"""Damage to files: what bad disks, other programs and bad people make of good ones."""

from __future__ import annotations

import io
import json
import random
import re
import zipfile
from collections.abc import Callable, Sequence

NASTY_NUMBERS = (
    *("-1", "0", "1", "3", "-0", "255", "256", "65536", "2147483647", "2147483648", "4294967295"),
    *("4294967296", "9223372036854775807", "-9223372036854775808", "18446744073709551616"),
    *(
        "1e20",
        "1e308",
        "1e309",
        "-1e308",
        "1e-320",
        "nan",
        "NaN",
        "-nan",
        "inf",
        "-inf",
        "Infinity",
    ),
    *(
        "²",
        "٣",
        "1_000",
        "0x10",
        "1,5",
        "1.",
        ".5",
        "+",
        "-",
        "e",
        "1e",
        "1e5000",
        "1e-5000",
        "3.7",
    ),
    *("true", "null", "99999999x99999999", "-3x4", "0x0", "\x00", "\x1b[31m", "9" * 5000),
)
"""Counts, indices and coordinates that break readers."""

EXTREMES = (
    *(b"\0" * 4, b"\0" * 8, b"\xff" * 4, b"\xff" * 8, b"\xff\xff\xff\x7f", b"\x7f\xff\xff\xff"),
    *(b"\x00\x00\xc0\x7f", b"\x00\x00\x80\x7f", b"\x00\x00\x80\xff", b"\0\0\0\0\0\0\xf0\x7f"),
)
"""Counts and floats of binary files: largest, smallest, NaN and infinite."""

DEPTH = 200_000

LARGEST = 5_000_000
"""Bytes of a damaged file."""

Mutation = Callable[[random.Random, bytes, Sequence[bytes]], bytes]


def mutated(rng: random.Random, data: bytes, others: Sequence[bytes]) -> bytes:
    """Return a file damaged in one to four ways; `others`: files to splice it with."""
    for _ in range(rng.choice((1, 1, 1, 2, 2, 4))):
        packed = data.startswith(b"PK\x03\x04") and rng.random() < 0.7
        if data.startswith(b"ISO-10303") and rng.random() < 0.7:
            data = nasty_entity(rng, data, others)
        elif packed:
            data = _inside_archive(rng, data, others)
        else:
            data = rng.choice(MUTATIONS)(rng, data, others)
        data = data[:LARGEST]
    return data


def flip_bits(rng: random.Random, data: bytes, others: Sequence[bytes]) -> bytes:
    """Flip some bits."""
    result = bytearray(data)
    for _ in range(rng.choice((1, 2, 8, 64))):
        if result:
            result[rng.randrange(len(result))] ^= 1 << rng.randrange(8)
    return bytes(result)


def set_bytes(rng: random.Random, data: bytes, others: Sequence[bytes]) -> bytes:
    """Overwrite a few bytes with extremes: counts and floats of binary files."""
    result = bytearray(data)
    for _ in range(rng.choice((1, 1, 4, 20))):
        place = rng.randrange(len(result) + 1)
        value = rng.choice(EXTREMES)
        result[place : place + len(value)] = value
    return bytes(result)


def cut(rng: random.Random, data: bytes, others: Sequence[bytes]) -> bytes:
    """Cut the file short."""
    return data[: rng.randrange(len(data) + 1)]


def remove_block(rng: random.Random, data: bytes, others: Sequence[bytes]) -> bytes:
    """Take a block out."""
    begin = rng.randrange(len(data) + 1)
    return data[:begin] + data[begin + rng.choice((1, 3, 17, 200)) :]


def repeat_block(rng: random.Random, data: bytes, others: Sequence[bytes]) -> bytes:
    """Write a block many times."""
    begin = rng.randrange(len(data) + 1)
    block = data[begin : begin + rng.choice((1, 4, 30, 200))]
    return data[:begin] + block * rng.choice((2, 10, 1000, 20_000)) + data[begin:]


def splice(rng: random.Random, data: bytes, others: Sequence[bytes]) -> bytes:
    """Begin like one file and go on like another."""
    other = rng.choice(others) if others else data
    return data[: rng.randrange(len(data) + 1)] + other[rng.randrange(len(other) + 1) :]


def nasty_number(rng: random.Random, data: bytes, others: Sequence[bytes]) -> bytes:
    """Replace a number of the text, more often one near its beginning."""
    window = data[: rng.choice((300, 1000, len(data)))]
    spans = [m.span() for m in re.finditer(rb"-?\d[\d.eE+-]*", window)]
    if not spans:
        return flip_bits(rng, data, others)
    begin, end = rng.choice(spans)
    return data[:begin] + rng.choice(NASTY_NUMBERS).encode() + data[end:]


def change_lines(rng: random.Random, data: bytes, others: Sequence[bytes]) -> bytes:
    """Remove, repeat or exchange lines."""
    lines = data.split(b"\n")
    for _ in range(rng.choice((1, 1, 3))):
        a, b = rng.randrange(len(lines)), rng.randrange(len(lines))
        action = rng.randrange(4)
        if action == 0 and len(lines) > 1:
            del lines[a]
        elif action == 1:
            lines[a:a] = [lines[b]] * rng.choice((1, 2, 3000))
        elif action == 2:
            lines[a], lines[b] = lines[b], lines[a]
        else:
            lines[a] += rng.choice((b" ", b"\r", b"\0", b"\t7", b" nan", b" #", b"\\", b"\xff"))
    return rng.choice((b"\n", b"\n", b"\n", b"\r\n", b"\r")).join(lines)


def change_words(rng: random.Random, data: bytes, others: Sequence[bytes]) -> bytes:
    """Exchange two words, or take one out."""
    words = re.split(rb"(\s+)", data[:20_000])
    a, b = rng.randrange(len(words)), rng.randrange(len(words))
    words[a], words[b] = words[b], rng.choice((words[a], b"", words[b]))
    return b"".join(words) + data[20_000:]


CAPITALS = ("NAN", "INFINITY", ".EXA.", ".PICO.", "$", "*", "#1", "#999999", "''", "(())", ".T.",
            "1.E+300", "1.E-300", "-1.", "0.")  # fmt: skip
"""What STEP files have in place of numbers, units and names."""


def nasty_entity(rng: random.Random, data: bytes, others: Sequence[bytes]) -> bytes:
    """Replace some numbers, units or names of entities in a STEP file, or swap two of its lines."""
    for _ in range(rng.choice((1, 1, 3, 20))):
        spans = [m.span() for m in re.finditer(rb"#\d+|\.[A-Z]+\.|-?\d+\.[\dE+-]*", data)]
        if len(spans) < 2 or rng.random() < 0.1:
            return nasty_number(rng, data, others)
        begin, end = rng.choice(spans)
        other = data[slice(*rng.choice(spans))]
        new = other if rng.random() < 0.4 else rng.choice(CAPITALS).encode()
        data = data[:begin] + new + data[end:]
    return data


def deep_brackets(rng: random.Random, data: bytes, others: Sequence[bytes]) -> bytes:
    """Nest brackets or elements deeper than any stack."""
    opening, closing = rng.choice(((b"[", b"]"), (b'{"a":', b"}"), (b"<a>", b"</a>"), (b"(", b")")))
    nest = opening * DEPTH + rng.choice((b"", b"1" + closing * DEPTH))
    place = rng.choice((0, rng.randrange(len(data) + 1)))
    return data[:place] + nest + data[place:]


def change_json(rng: random.Random, data: bytes, others: Sequence[bytes]) -> bytes:
    """Remove a key, or put another value in its place, anywhere in a JSON text."""
    try:
        content = json.loads(data)
    except (ValueError, RecursionError):
        return nasty_number(rng, data, others)
    places: list[tuple[dict[str, object] | list[object], str | int]] = []
    waiting = [content]
    while waiting:
        item = waiting.pop()
        if not isinstance(item, dict | list):
            continue
        for key, value in item.items() if isinstance(item, dict) else enumerate(item):
            places.append((item, key))
            waiting.append(value)
    if not places:
        return data
    holder, key = rng.choice(places)
    action = rng.randrange(4)
    if action == 0:
        del holder[key]  # type: ignore[arg-type]
    elif action == 1:
        bad: tuple[object, ...] = (
            None,
            -7,
            10**30,
            1e308,
            float("nan"),
            float("inf"),
            "²",
            "",
            [],
            {},
            [[1]],
            True,
        )
        holder[key] = rng.choice(bad)  # type: ignore[index]
    elif action == 2:
        most = 1 + LARGEST // (len(data) + 1)
        holder[key] = [holder[key]] * min(most, rng.choice((0, 2, 1000)))  # type: ignore[index]
    else:
        holder[key] = "\x1b[31m../../" + "x" * rng.choice((1, 5000))  # type: ignore[index]
    return json.dumps(content).encode()


def _inside_archive(rng: random.Random, data: bytes, others: Sequence[bytes]) -> bytes:
    """Damage a member of a zip archive, whose checksums stay right."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = {name: archive.read(name) for name in archive.namelist()}
    except Exception:  # noqa: BLE001 - damaged already
        return flip_bits(rng, data, others)
    if not members:
        return flip_bits(rng, data, others)
    name = rng.choice(sorted(members))
    changed = rng.choice(MUTATIONS)(rng, members[name], list(members.values()))
    if rng.random() < 0.1:
        members.pop(name)
        name = rng.choice(("../up", "/absolute", "a\\b", "x" * 3000, name + ".npy", " ", "²"))
    members[name] = changed
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", rng.choice((0, zipfile.ZIP_DEFLATED))) as archive:
        for member, content in members.items():
            archive.writestr(zipfile.ZipInfo(member), content)
    return stream.getvalue()


MUTATIONS: tuple[Mutation, ...] = (
    *(flip_bits, set_bytes, cut, remove_block, repeat_block, splice, nasty_number, nasty_number),
    *(nasty_number, change_lines, change_words, deep_brackets, change_json),
)
"""More often what readers met least: numbers."""
