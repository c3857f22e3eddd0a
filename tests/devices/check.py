"""Compares what packages of the field make of our device bytes with what the arena says of the same moments.

Usage: check.py ECHO_JSON FRAMES_JSON

ECHO_JSON has the lines of `arena echo --json` of the device topics and of what the bridges made of them; FRAMES_JSON
those of `cargo run -p device --example frames`.

Independent of our own code are:
- XBee's API frames: digi-xbee, its maker's;
- SBUS: rfrx (its channels; it reads the flags from the wrong end of their byte);
- CRTP: cflib, its maker's;
- the payload's check: binascii's CRC;
- Tracker's object stream, and our own frames within channels and payloads: no package knows them. They are read here
  from their tables, with `struct`.
"""

import binascii
import json
import math
import struct
import sys
from collections import defaultdict
from types import SimpleNamespace

from cflib.crazyflie.commander import Commander
from cflib.crazyflie.localization import Localization
from cflib.crazyflie.supervisor import Supervisor
from digi.xbee.models.address import XBee16BitAddress, XBee64BitAddress
from digi.xbee.models.mode import OperatingMode
from digi.xbee.models.status import ModemStatus, TransmitStatus
from digi.xbee.packets import common, raw
from digi.xbee.packets.base import XBeePacket
from digi.xbee.packets.factory import build_frame
from rfrx.sbus import SbusDecoder

DATA_LINK, COMMAND_LINK = 0, 0x100
MODES = ["DISARMED", "FLYING", "MANEUVER", "LEVEL_HOLD", "DESCEND", "LANDED", "STOPPED"]
PHASES = ["NONE", "RUNNING", "COMPLETED", "ABORTED", "REFUSED"]
ITEMS = [
    "u1_m_s2",
    "t1_s",
    "t3_s",
    "u5_m_s2",
    "t5_s",
    "rate_rad_s_max",
    "envelope_low_m_s2",
    "envelope_high_m_s2",
    "lever_m",
    "flips",
]


def echoed(path):
    """What `arena echo` printed: bodies by topic, in order."""
    bodies = defaultdict(list)
    with open(path) as file:
        for line in file:
            message = json.loads(line)
            assert "error" not in message, message
            bodies[message["topic"]].append(message["body"])
    return bodies


def near(one, other, most, what):
    assert abs(one - other) <= most, (what, one, other)


def nanos(time):
    return time["sec"] * 1_000_000_000 + time["nsec"]


def product(one, other):
    return [[sum(a * b for a, b in zip(row, column)) for column in zip(*other)] for row in one]


def turned_about_the_new_axes(x, y, z):
    """The matrix of a turn about x, then the new y, then the newest z."""
    (sx, cx), (sy, cy), (sz, cz) = ((math.sin(angle), math.cos(angle)) for angle in (x, y, z))
    about_x = [[1, 0, 0], [0, cx, -sx], [0, sx, cx]]
    about_y = [[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]]
    about_z = [[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]]
    return product(product(about_x, about_y), about_z)


def matrix(q):
    """The matrix of a quaternion."""
    x, y, z, w = q["x"], q["y"], q["z"], q["w"]
    return [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]


def check_vicon(told):
    """Tracker's datagrams, against the frames that the bridge made of them."""
    frames = {body["frame"] & 0xFFFF_FFFF: body for body in told["mocap/frame"]}
    objects = 0
    for datagram in told["vicon/rx"]:
        data = bytes(datagram["bytes"])
        number, count = struct.unpack_from("<IB", data)
        assert len(data) >= 5 + 75 * count, "cut short"
        bodies = {body["subject"]: body for body in frames[number]["bodies"]}
        for index in range(count):
            item, size, name, *pose = struct.unpack_from("<BH24s6d", data, 5 + 75 * index)
            assert (item, size) == (0, 72), (number, item, size)
            body = bodies[name.rstrip(b"\0").decode()]
            for axis, millimetres in zip("xyz", pose[:3]):
                near(body["position_m"][axis], millimetres * 1e-3, 1e-12, (number, axis))
            expected, found = turned_about_the_new_axes(*pose[3:]), matrix(body["orientation"])
            for row, other in zip(expected, found):
                for one, two in zip(row, other):
                    near(one, two, 1e-12, (number, "attitude"))
            objects += 1
    assert objects > 1000, objects
    print(f"vicon: {len(told['vicon/rx'])} datagrams, {objects} objects: as the bridge read them")


def crc11(words):
    crc = 0
    for word in words:
        for bit in range(10, -1, -1):
            high = (crc >> 10 ^ word >> bit) & 1
            crc = (crc << 1 & 0x7FF) ^ (0x307 if high else 0)
    return crc


def check_sbus(told):
    """The command link, against what the bridge says that it sent."""
    sent = {(body["vehicle"], nanos(body["sent_at"])): body for body in told["vehicle/command-sent"]}
    checked = 0
    for tx in told["radio/tx"]:
        if tx["port"] & 0xFF00 != COMMAND_LINK:
            continue
        channels = SbusDecoder(bytes(tx["bytes"])).chans
        assert crc11(channels[:15]) == channels[15] and channels[14] == 2, channels
        vehicle = tx["port"] & 0xFF
        assert channels[9] == vehicle
        body = sent.get((vehicle, nanos(tx["at"])))
        assert body is not None, "a command that the bridge does not speak of"
        assert channels[4] // 16 // 32 == {"DISARMED": 0, "FLY": 1, "DESCEND": 2, "STOP": 3}[body["mode"]], body
        assert channels[10] == body["lease_epoch"] & 0xFF
        for channel, axis in ((0, "x"), (1, "y"), (3, "z")):
            rate = max((channels[channel] - 1024) * 12 / 1023, -12.0)
            near(rate, body["rate_rad_s"][axis], 1e-9, (channel, body))
        near(channels[2] * 24 / 2047, body["collective_m_s2"], 1e-9, body)
        checked += 1
    assert checked > 500, checked
    print(f"rfrx, SBUS: {checked} frames: as the bridge says that it sent them")


def fnv1a(data):
    digest = 0xCBF29CE484222325
    for byte in data:
        digest = (digest ^ byte) * 0x100000001B3 & 0xFFFFFFFFFFFFFFFF
    return digest


def payload(data):
    """Type, vehicle and body of a payload; nothing where its check does not come out."""
    data = bytes(data)
    if binascii.crc_hqx(data[:-2], 0xFFFF) != struct.unpack("<H", data[-2:])[0]:
        return None
    return data[0], data[1], data[2:-2]


def frames_of(lines, create):
    """The frames in the serial line's portions, each with the portion's message; every frame in one portion."""
    for line in lines:
        data = bytearray(line["bytes"])
        starts = [at for at, byte in enumerate(data) if byte == 0x7E] + [len(data)]
        assert starts[0] == 0, "no frame begins the portion"
        for start, end in zip(starts, starts[1:]):
            escaped = data[start:end]
            packet = create(XBeePacket.unescape_data(escaped), OperatingMode.ESCAPED_API_MODE)
            assert packet.output(escaped=True) == escaped, (packet, bytes(escaped).hex())
            yield line, packet


def check_uplink(told):
    """What goes to the vehicles, against the orders on the bus."""
    uploads = {(body["vehicle"], body["set_id"]): body for body in told["maneuver/upload"]}
    starts = {(body["vehicle"], body["maneuver_id"]): body for body in told["maneuver/start"]}
    seen, counts = defaultdict(set), defaultdict(int)
    lines = (tx for tx in told["radio/tx"] if tx["port"] == DATA_LINK)
    for _, packet in frames_of(lines, raw.TX16Packet.create_packet):
        assert packet.x16bit_dest_addr.address[0] == 0x50, packet
        kind, vehicle, body = payload(packet.rf_data)
        counts[kind] += 1
        if kind == 1:
            set_id, count, digest = struct.unpack("<HBQ", body)
            assert (count, digest) == (len(ITEMS), uploads[vehicle, set_id]["digest"])
        elif kind == 2:
            set_id, first, count = struct.unpack_from("<HBB", body)
            assert len(body) == 4 + 4 * count
            upload = uploads[vehicle, set_id]
            told_items = [struct.pack("<f", upload[name]) for name in ITEMS]
            assert fnv1a(b"".join(told_items)) == upload["digest"], upload
            for index in range(count):
                assert body[4 + 4 * index : 8 + 4 * index] == told_items[first + index], (upload, first + index)
                seen[vehicle, set_id].add(first + index)
        elif kind == 3:
            set_id, digest = struct.unpack("<HQ", body)
            assert digest == uploads[vehicle, set_id]["digest"]
        elif kind == 4:
            maneuver_id, set_id, digest = struct.unpack("<HHQ", body)
            order = starts[vehicle, maneuver_id]
            assert (set_id, digest) == (order["set_id"], order["digest"]), order
        else:
            assert kind in (5, 6), f"payload of type {kind}"
    assert all(counts[kind] for kind in (1, 2, 3, 4, 6)), dict(counts)
    assert all(seen[key] == set(range(len(ITEMS))) for key in uploads), "an upload of which not all was sent"
    print(f"digi-xbee, to the vehicles: {sum(counts.values())} frames, {len(uploads)} uploads: as ordered")


def check_downlink(told):
    """What comes from the vehicles, against the telemetry that the bridge made of it."""
    telemetry = {(body["vehicle"], nanos(body["received_at"])): body for body in told["vehicle/telemetry"]}
    counts = defaultdict(int)
    for line, packet in frames_of(told["radio/rx"], build_frame):
        counts[type(packet).__name__] += 1
        if not isinstance(packet, raw.RX16Packet):
            continue
        received = payload(packet.rf_data)
        if received is None:
            # The simulated air bends some; the bridge must have seen it too.
            assert not any(at == nanos(line["at"]) for _, at in telemetry), "a bent report was believed"
            counts["bent"] += 1
            continue
        kind, vehicle, body = received
        assert packet.x16bit_source_addr.address[1] == vehicle, "another vehicle's address"
        if kind != 0x81:
            continue
        counts["status"] += 1
        fields = struct.unpack("<QBHHQHBBQQHBQB", body)
        _, mode, battery_mv, set_id, set_digest, maneuver_id, phase, reason, _, _, age_ms, _, _, _ = fields
        report = telemetry[vehicle, nanos(line["at"])]
        assert (MODES[mode], PHASES[phase]) == (report["mode"], report["maneuver_phase"]), report
        assert (set_id, set_digest, maneuver_id, reason) == (
            report["set_id"],
            report["set_digest"],
            report["maneuver_id"],
            report["reason"],
        ), report
        near(battery_mv * 1e-3, report["battery_v"], 1e-9, report)
        near(age_ms * 1e-3, report["command_age_s"], 1e-9, report)
    assert counts["status"] == len(telemetry) > 300 and counts["TXStatusPacket"] > 50, dict(counts)
    assert counts["bent"] < 20, dict(counts)
    print(f"digi-xbee, from the vehicles: {dict(counts)}: as the bridge reported them")


def made_by_digi(kind, escaped, arguments):
    """The frame that digi-xbee makes of these."""
    convert = {4: XBee16BitAddress, 16: XBee64BitAddress}
    if kind is common.ModemStatusPacket:
        packet = kind(ModemStatus.get(arguments[0]))
    elif kind is raw.TXStatusPacket:
        packet = kind(arguments[0], TransmitStatus.get(arguments[1]))
    else:
        *fields, data = arguments
        fields = [
            convert[len(field)](bytearray.fromhex(field)) if isinstance(field, str) else field for field in fields
        ]
        packet = kind(*fields, bytearray.fromhex(data))
    return packet.output(escaped=escaped)


def made_by_cflib(targets, sent, call, arguments):
    """The packet that cflib sends when asked so."""
    sent.clear()
    target = next(target for target in targets if hasattr(target, call))
    getattr(target, call)(*arguments)
    (packet,) = sent
    return bytes([packet.get_header()]) + bytes(packet.data)


def check_frames(path):
    """Our frames of any values, against the same made by the packages."""
    sent, counts = [], defaultdict(int)
    vehicle = SimpleNamespace(
        send_packet=lambda packet: sent.append(packet),
        add_port_callback=lambda *_: None,
        platform=SimpleNamespace(get_protocol_version=lambda: 12),
    )
    # The supervisor's own emergency stop, not the older one of the same name.
    targets = [Supervisor(vehicle), Commander(vehicle), Localization(vehicle)]
    with open(path) as file:
        for line in map(json.loads, file):
            ours = bytearray.fromhex(line["hex"])
            if line["package"] == "cflib":
                theirs = made_by_cflib(targets, sent, line["call"], line["arguments"])
            else:
                kind = getattr(raw, line["call"], None) or getattr(common, line["call"])
                escaped, *arguments = line["arguments"]
                theirs = made_by_digi(kind, escaped, arguments)
                mode = OperatingMode.ESCAPED_API_MODE if escaped else OperatingMode.API_MODE
                read = kind.create_packet(XBeePacket.unescape_data(ours) if escaped else bytearray(ours), mode)
                assert read.output(escaped=escaped) == ours, (line, read)
            assert theirs == ours, (line, bytes(theirs).hex())
            counts[line["package"]] += 1
    assert counts["cflib"] > 1000 and counts["digi-xbee"] > 1000, dict(counts)
    print(f"frames of any values: {dict(counts)}: the same bytes")


def main():
    echo, frames = sys.argv[1:]
    told = echoed(echo)
    check_vicon(told)
    check_sbus(told)
    check_uplink(told)
    check_downlink(told)
    check_frames(frames)


if __name__ == "__main__":
    main()
