"""The command and data link as docs/hardware.md describes them, read from a recording without any of the project's code.

    arena echo radio/tx FILE --json > tx; arena echo radio/rx FILE --json > rx
    arena echo vehicle/command-sent FILE --json > sent; arena echo vehicle/telemetry FILE --json > telemetry
    python3 link.py tx rx sent telemetry

Written from the page alone. Every byte of both radios must decode, every command must be the one the bridge reports, and
every status must be the telemetry that the bridge made of it.
"""

import collections
import json
import math
import struct
import sys


def bits(word, count):
    return [(word >> bit) & 1 for bit in reversed(range(count))]


def crc_words(words, count, polynomial):
    crc = 0
    for word in words:
        for bit in bits(word, count):
            feedback = ((crc >> (count - 1)) ^ bit) & 1
            crc = (crc << 1) & ((1 << count) - 1)
            if feedback:
                crc ^= polynomial
    return crc


def crc16(data):
    crc = 0xFFFF
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = ((crc << 1) ^ 0x1021) & 0xFFFF if crc & 0x8000 else crc << 1
    return crc


def fnv1a(data):
    value = 0xCBF29CE484222325
    for byte in data:
        value = ((value ^ byte) * 0x100000001B3) % 2**64
    return value


def sbus_channels(frame):
    assert len(frame) == 25 and frame[0] == 0x0F and frame[23:] == b"\0\0", frame.hex()
    packed = int.from_bytes(frame[1:23], "little")
    return [(packed >> (11 * channel)) & 0x7FF for channel in range(16)]


def command(frame):
    c = sbus_channels(frame)
    assert c[15] == crc_words(c[:15], 11, 0x307), c
    assert c[14] == 2 and c[11] <= 3 and c[9] <= 255 and c[10] <= 255, c

    def two_sided(raw, limit):
        return max(-limit, (raw - 1024) * limit / 1023)

    mode, counter = divmod(c[4] // 16, 32)
    return {
        "vehicle": c[9],
        "mode": mode,
        "counter": counter,
        "rates": [two_sided(c[channel], 12) for channel in (0, 1, 3)],
        "collective": c[2] * 24 / 2047,
        "roll": two_sided(c[5], math.pi),
        "pitch": two_sided(c[6], math.pi / 2),
        "height": c[7] * 16 / 2047 - 1,
    }


def xbee_frames(stream):
    """The frame data of each API frame with escapes."""
    for part in stream.split(b"\x7e")[1:]:
        plain, escaped = bytearray(), False
        for byte in part:
            if byte == 0x7D:
                escaped = True
            else:
                plain.append(byte ^ 0x20 if escaped else byte)
                escaped = False
        length = int.from_bytes(plain[:2], "big")
        data, checksum = bytes(plain[2 : 2 + length]), plain[2 + length]
        assert len(plain) == length + 3 and (sum(data) + checksum) & 0xFF == 0xFF, plain.hex()
        yield data


BODIES = {0x03: "<HQ", 0x04: "<HHQ", 0x05: "<H", 0x06: "<H", 0x07: "<", 0x08: "<", 0x01: "<HBQ"}
BODIES |= {0x81: "<QBHHQHBBQQHBQB", 0x82: "<HQI", 0x83: "<HBIQB"}


def is_whole(data):
    return 4 <= len(data) <= 100 and struct.unpack("<H", data[-2:])[0] == crc16(data[:-2])


def payload(data):
    assert is_whole(data), data.hex()
    kind, vehicle, body = data[0], data[1], data[2:-2]
    if kind == 0x02:
        set_id, first, number = struct.unpack("<HBB", body[:4])
        return kind, vehicle, (set_id, first, struct.unpack(f"<{number}f", body[4:]))
    return kind, vehicle, struct.unpack(BODIES[kind], body)


def lines(path):
    with open(path, encoding="utf-8") as file:
        return [json.loads(line) for line in file]


def main(tx, rx, sent, telemetry):
    counts = collections.Counter()
    commands = collections.defaultdict(list)
    sets = {}
    for line in lines(tx):
        body = line["body"]
        raw = bytes(body["bytes"])
        if body["port"] == 0:
            for data in xbee_frames(raw):
                assert data[0] == 0x01 and data[4] == 0, data.hex()
                kind, vehicle, fields = payload(data[5:])
                counts[f"tx {kind:02x}"] += 1
                if kind == 0x02:
                    sets[fields[0]] = fields[2]
                if kind == 0x03:
                    items = b"".join(struct.pack("<f", item) for item in sets[fields[0]])
                    assert fnv1a(items) == fields[1], "the digest of the items is another"
        else:
            found = command(raw)
            assert body["port"] == 0x100 + found["vehicle"], body["port"]
            # An emergency stop is nobody's command.
            if found["mode"] != 3:
                commands[found["vehicle"]].append(found)
            counts["tx command"] += 1
    for line in lines(sent):
        body = line["body"]
        expected = commands[body["vehicle"]].pop(0)
        rates = [body["rate_rad_s"][axis] for axis in "xyz"]
        pairs = list(zip(rates, expected["rates"])) + [(body["collective_m_s2"], expected["collective"])]
        assert all(abs(a - b) < 1e-9 for a, b in pairs), (body, expected)
        counts["sent"] += 1
    reports = []
    for data in xbee_frames(b"".join(bytes(line["body"]["bytes"]) for line in lines(rx) if line["body"]["port"] == 0)):
        if data[0] == 0x81 and not is_whole(data[5:]):
            # The simulated air bends one payload in 500, which the bridge must drop too.
            counts["rx damaged"] += 1
        elif data[0] == 0x81:
            kind, vehicle, fields = payload(data[5:])
            counts[f"rx {kind:02x}"] += 1
            if kind == 0x81:
                reports.append((vehicle, fields))
        else:
            assert data[0] == 0x89, data.hex()
    told = lines(telemetry)
    assert len(told) == len(reports), (len(told), len(reports))
    for line, (vehicle, fields) in zip(told, reports):
        body = line["body"]
        assert body["vehicle"] == vehicle and body["set_id"] == fields[3] and body["maneuver_id"] == fields[5]
        assert abs(body["battery_v"] - fields[2] / 1000) < 1e-6, (body, fields)
    assert not any(commands.values()) and counts["sent"] and counts["rx 81"], counts
    assert counts["rx damaged"] * 50 < counts["rx 81"], counts
    print(", ".join(f"{count} {name}" for name, count in sorted(counts.items())))


main(*sys.argv[1:])
