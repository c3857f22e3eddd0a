"""Compares what cflib, its maker's client, makes of a Crazyflie's packets with what the arena says of the same moments.

Usage: crazyflie.py ECHO_JSON

ECHO_JSON has the lines of `arena echo --json` of a recording in which a Crazyflie flew: radio/tx, radio/rx,
vehicle/command-sent and vehicle/telemetry.
"""

import math
import struct
import sys
from collections import defaultdict
from types import SimpleNamespace

from cflib.crazyflie.commander import Commander
from cflib.crazyflie.log import LogConfig, LogTocElement
from cflib.crazyflie.supervisor import Supervisor
from cflib.crtp.crtpstack import CRTPPacket, CRTPPort

from check import COMMAND_LINK, echoed, nanos, near


class Vehicle:
    """In the place of cflib's connection: keeps what is sent, and hands over what came."""

    def __init__(self):
        self.sent = []
        self.callbacks = {}
        self.platform = SimpleNamespace(get_protocol_version=lambda: 12)

    def send_packet(self, packet, **_):
        self.sent.append(bytes([packet.get_header()]) + bytes(packet.data))

    def add_port_callback(self, port, callback):
        self.callbacks[port] = callback

    def last(self):
        return self.sent[-1]


def packets(lines):
    """cflib's packets in the messages of a command link."""
    for line in lines:
        if line["port"] & 0xFF00 == COMMAND_LINK:
            data = bytes(line["bytes"])
            packet = CRTPPacket(data[0], list(data[1:]))
            assert packet.get_header() == data[0], data.hex()
            yield line, packet, data


def check_commands(told):
    """What goes to the vehicle: the same packets as cflib's for what the bridge says it sent."""
    sent = {(body["vehicle"], nanos(body["sent_at"])): body for body in told["vehicle/command-sent"]}
    vehicle, counts, full = Vehicle(), defaultdict(int), None
    commander, supervisor = Commander(vehicle), Supervisor(vehicle)
    for line, packet, data in packets(told["radio/tx"]):
        if packet.port == CRTPPort.SUPERVISOR and packet.channel == 1:
            assert data[1] == 1, data.hex()
            supervisor.send_arming_request(bool(data[2]))
            assert data == vehicle.last(), (data.hex(), vehicle.last().hex())
            counts["arming"] += 1
        if packet.port != CRTPPort.COMMANDER_GENERIC:
            continue
        body = sent.get((line["port"] & 0xFF, nanos(line["at"])))
        assert body is not None, "a command that the bridge does not speak of"
        if data[1] == 0:
            commander.send_stop_setpoint()
            assert data == vehicle.last() and body["mode"] == "DISARMED", (data.hex(), body)
            counts["stop"] += 1
            continue
        rate = [math.degrees(body["rate_rad_s"][axis]) for axis in "xyz"]
        commander.send_setpoint_manual(*rate, 0, True)
        theirs = vehicle.last()
        # The thrust apart: the package counts it in percent. The rest is the same but for rounding to and fro.
        assert (data[:2], data[16:]) == (theirs[:2], theirs[16:]) and len(data) == len(theirs), (data.hex(), body)
        for one, other in zip(struct.unpack("<3f", data[2:14]), struct.unpack("<3f", theirs[2:14])):
            near(one, other, 1e-4, (data.hex(), body))
        thrust = struct.unpack("<H", data[14:16])[0]
        if thrust > 0:
            full = full or body["collective_m_s2"] / thrust
            near(body["collective_m_s2"], full * thrust, 1e-9, body)
        counts["manual"] += 1
    assert counts["manual"] > 200 and counts["stop"] and counts["arming"], dict(counts)
    print(f"cflib, to a Crazyflie: {dict(counts)}: the packets of its client for what the bridge says it sent")


def check_reports(told):
    """What comes from the vehicle: the names, types, states and values that cflib reads."""
    vehicle, states, elements = Vehicle(), defaultdict(int), {}
    supervisor = Supervisor(vehicle)
    battery, read = LogConfig("battery", 100), []
    battery.add_variable("pm.vbat", "float")
    battery.data_received_cb.add_callback(lambda _, values, __: read.append(values["pm.vbat"]))
    volts = []
    for line, packet, data in packets(told["radio/rx"]):
        if packet.port == CRTPPort.SUPERVISOR:
            vehicle.callbacks[CRTPPort.SUPERVISOR](packet)
            if packet.channel == 0:
                for name in supervisor.decode_bitfield(supervisor._bitfield):
                    states[name] += 1
        elif packet.port == CRTPPort.LOGGING and packet.channel == 0 and data[1] == 2:
            ident = struct.unpack("<H", data[2:4])[0]
            elements[ident] = LogTocElement(ident, bytearray(data[4:]))
        elif packet.port == CRTPPort.LOGGING and packet.channel == 2:
            battery.unpack_log_data(data[5:], int.from_bytes(data[2:5], "little"))
            volts.append((nanos(line["at"]), read[-1]))
    known = {f"{element.group}.{element.name}": element for element in elements.values()}
    assert known["pm.vbat"].ctype == "float", known
    created = [data for _, packet, data in packets(told["radio/tx"]) if data[0] == 0x5D and data[1] == 6]
    ident, kind = known["pm.vbat"].ident, battery.variables[0].get_storage_and_fetch_byte()
    assert created and all(data[3:] == struct.pack("<BH", kind, ident) for data in created), created
    checked = 0
    for report in told["vehicle/telemetry"]:
        before = [volt for at, volt in volts if at <= nanos(report["received_at"])]
        if before:
            near(report["battery_v"], before[-1], 1e-9, report)
            checked += 1
    assert checked > 50 and set(states) == {"Can be armed", "Is armed", "Can fly", "Is flying"}, (checked, states)
    print(f"cflib, from a Crazyflie: {sorted(known)}, {len(volts)} voltages, states {dict(states)}: as the bridge reported")


def main():
    (echo,) = sys.argv[1:]
    told = echoed(echo)
    check_commands(told)
    check_reports(told)


if __name__ == "__main__":
    main()
