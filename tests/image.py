#!/usr/bin/env python3
"""Writes what of an ELF program is put into a chip's memory, to the standard output: the loaded segments with their
addresses. Usage: image.py PROGRAM"""
import struct
import sys

LOAD = 1


def segments(elf):
    """Address and bytes of every loaded segment of a 32-bit little-endian ELF file."""
    if elf[:6] != b"\x7fELF\x01\x01":
        sys.exit("not a 32-bit little-endian ELF file")
    start, size, count = struct.unpack_from("<I", elf, 28) + struct.unpack_from("<HH", elf, 42)
    for k in range(count):
        kind, offset, _, address, length = struct.unpack_from("<5I", elf, start + k * size)
        if kind == LOAD and length:
            yield address, elf[offset : offset + length]


with open(sys.argv[1], "rb") as file:
    program = list(segments(file.read()))
if not program:
    sys.exit("nothing is loaded")
for address, content in program:
    sys.stdout.buffer.write(struct.pack("<2I", address, len(content)) + content)
