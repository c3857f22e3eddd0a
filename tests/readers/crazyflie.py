"""What went over a Crazyflie's radio in a recording, by Bitcraze's own library: every packet that its client would send is
built by that client from the values we read and must come to the same bytes; every packet of the vehicle is read by it."""

import logging
import struct
import sys
import types
from collections import Counter

from cflib.crazyflie.commander import Commander
from cflib.crazyflie.log import Log, LogConfig, LogTocElement
from cflib.crazyflie.supervisor import Supervisor
from cflib.crtp.crtpstack import CRTPPacket, CRTPPort
from mcap.reader import make_reader
from mcap_ros1.decoder import DecoderFactory

VEHICLE = 0x100 | 5
TOC, CONTROL, DATA = 0, 1, 2


class Client:
    """Stands where the library expects a connection: keeps what it sends."""

    def __init__(self):
        self.sent = []
        # Supervisor's port is there from this version on.
        self.platform = types.SimpleNamespace(get_protocol_version=lambda: 12)
        self.log = types.SimpleNamespace(toc=self, log_blocks=[])
        self.link = self
        self.ids = {}

    def add_port_callback(self, port, callback):
        pass

    def get_element_id(self, name):
        return self.ids[name]

    def send_packet(self, packet, expected_reply=(), **_):
        self.sent.append(bytes([packet.header]) + bytes(packet.data))

    def last(self):
        return self.sent.pop()


def packets(recording, topic):
    with open(recording, "rb") as file:
        for _, _, _, message in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages(topics=[topic]):
            if message.port == VEHICLE:
                yield bytes(message.bytes)


def check_sent(packet, client, counts):
    header, data = packet[0], packet[1:]
    port, channel = header >> 4, header & 3
    parsed = CRTPPacket(header, bytearray(data))
    assert (parsed.port, parsed.channel) == (port, channel), packet.hex()
    supervisor, commander = Supervisor(client), Commander(client)
    if port == CRTPPort.COMMANDER_GENERIC and data[0] == 0:
        counts["stop"] += 1
        commander.send_stop_setpoint()
        assert client.last() == packet, packet.hex()
    elif port == CRTPPort.COMMANDER_GENERIC and data[0] == 11:
        _, roll, pitch, yaw, thrust, rate = struct.unpack("<BfffHB", data)
        counts["manual"] += 1
        if 10001 <= thrust <= 60000:
            commander.send_setpoint_manual(roll, -pitch, yaw, (thrust + 0.5 - 10001) / 499.99, rate == 1)
            assert client.last() == packet, packet.hex()
            counts["manual, byte for byte"] += 1
    elif port == CRTPPort.SUPERVISOR and channel == 0:
        counts["state asked"] += 1
        supervisor._fetch_bitfield(timeout=0)
        assert client.last() == packet, packet.hex()
    elif port == CRTPPort.SUPERVISOR and data[0] == 1:
        counts["arm"] += 1
        supervisor.send_arming_request(bool(data[1]))
        assert client.last() == packet, packet.hex()
    elif port == CRTPPort.LOGGING and channel == CONTROL and data[0] in (3, 6):
        counts["log"] += 1
        block = LogConfig("battery", 100)
        block.id, block.cf, block.useV2 = 1, client, True
        block.add_variable("pm.vbat", "float")
        block.create() if data[0] == 6 else block.__dict__.update(_added=True) or block.start()
        assert client.last() == packet, packet.hex()
    elif port == CRTPPort.LINKCTRL or port == CRTPPort.LOGGING:
        counts["echo" if port == CRTPPort.LINKCTRL else "log"] += 1
    else:
        raise AssertionError(f"nobody's packet: {packet.hex()}")


def check_heard(packet, client, reader, counts):
    header, data = packet[0], packet[1:]
    port, channel = header >> 4, header & 3
    if port == CRTPPort.LOGGING and channel == TOC and data[0] == 2 and len(data) > 1:
        counts["variable"] += 1
        ident = struct.unpack_from("<H", data, 1)[0]
        element = LogTocElement(ident, bytearray(data[3:]))
        client.ids[f"{element.group}.{element.name}"] = ident
    elif port == CRTPPort.LOGGING and channel == TOC and data[0] == 3:
        counts["contents"] += 1
        count, _, blocks, variables = struct.unpack("<HIBB", data[1:])
        assert count > 0 and (blocks, variables) == (Log.MAX_BLOCKS, Log.MAX_VARIABLES), packet.hex()
    elif port == CRTPPort.LOGGING and channel == CONTROL:
        counts["log answer"] += 1
        assert len(data) == 3 and data[2] == 0, packet.hex()
    elif port == CRTPPort.LOGGING and channel == DATA:
        block = LogConfig("battery", 100)
        block.add_variable("pm.vbat", "float")
        read = []
        block.data_received_cb.add_callback(lambda at, values, _: read.append(values["pm.vbat"]))
        block.unpack_log_data(data[4:], data[1] | data[2] << 8 | data[3] << 16)
        assert 3.0 < read[0] < 4.3, read
        counts["voltage"] += 1
    elif port == CRTPPort.SUPERVISOR:
        reader._supervisor_callback(CRTPPacket(header, bytearray(data)))
        if data[0] == 0x8C:
            counts["state"] += 1
            counts.update(reader.decode_bitfield(reader._bitfield))
    elif port == CRTPPort.LINKCTRL:
        counts["echo"] += 1
    else:
        raise AssertionError(f"nobody's packet: {packet.hex()}")


def main():
    recording = sys.argv[1]
    # Nobody answers its requests here, which it warns of.
    logging.disable(logging.WARNING)
    client, sent, heard = Client(), Counter(), Counter()
    reader = Supervisor(client)
    for packet in packets(recording, "radio/rx"):
        check_heard(packet, client, reader, heard)
    for packet in packets(recording, "radio/tx"):
        check_sent(packet, client, sent)
    print("cflib, from the vehicle:", dict(heard))
    print("cflib, to the vehicle:", dict(sent))
    for kind in ("manual, byte for byte", "arm", "state asked", "log", "echo"):
        assert sent[kind] > 0, kind
    for kind in ("voltage", "state", "Is armed", "Is flying", "variable", "echo"):
        assert heard[kind] > 0, kind


if __name__ == "__main__":
    main()
