"""Kernel that decompresses LZF, the compression of PCD files."""

from __future__ import annotations

from medialis.base.jit import kernel


@kernel
def unpack_lzf(packed, out_block):
    """Decompress into `out_block`; return the number of bytes written, -1 if `packed` is damaged.

    A control byte c < 32 is followed by c + 1 bytes that are copied. Otherwise it starts a back
    reference: the length is 2 plus its upper 3 bits (plus the next byte if these are 7), the
    distance is 1 plus its lower 5 bits and the byte after them. References may overlap their copy.
    """
    at, end, size = 0, 0, len(packed)
    while at < size:
        control = int(packed[at])
        at += 1
        if control < 32:
            length = control + 1
            if at + length > size or end + length > len(out_block):
                return -1
            for k in range(length):
                out_block[end + k] = packed[at + k]
            at += length
        else:
            length = 2 + (control >> 5)
            if length == 9:
                if at >= size:
                    return -1
                length += int(packed[at])
                at += 1
            if at >= size:
                return -1
            start = end - 1 - ((control & 31) << 8) - int(packed[at])
            at += 1
            if start < 0 or end + length > len(out_block):
                return -1
            for k in range(length):
                out_block[end + k] = out_block[start + k]
        end += length
    return end
