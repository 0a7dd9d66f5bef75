"""Checksums by their definitions, byte by byte; nothing imported from the project."""


def fletcher(data: bytes) -> bytes:
    """Fletcher's sum of eight bits, as Inertial Sense, u-blox and MIP send it."""
    low = high = 0
    for byte in data:
        low = (low + byte) % 256
        high = (high + low) % 256
    return bytes((low, high))


def crc24(data: bytes) -> int:
    """CRC-24Q, bit by bit."""
    crc = 0
    for byte in data:
        crc ^= byte << 16
        for _ in range(8):
            crc = (crc << 1) ^ 0x1864CFB if crc & 0x800000 else crc << 1
    return crc & 0xFFFFFF
