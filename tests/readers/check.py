"""Compares what third-party readers make of a recording with what `arena echo --json` says, field by field.

Usage: check.py RECORDING ROS2_EXPORT ECHO_JSON EXPORT_JSON

Differences of representation, and no others, are mapped:
- enumerations: echo has the name, readers the number; the definition's constants say which name has which number;
- time: echo has sec and nsec; ROS 1's readers secs and nsecs or sec and nanosec, ROS 2's sec and nanosec;
- float32: echo has the shortest text, readers the number widened to eight bytes;
- sequences of numbers: readers may have bytes or arrays.
"""

import json
import re
import struct
import sys
from collections import defaultdict
from pathlib import Path

import numpy
from mcap.reader import make_reader
from mcap_ros1.decoder import DecoderFactory as Ros1Decoder
from mcap_ros2.decoder import DecoderFactory as Ros2Decoder
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

SEPARATOR = "=" * 80


def parse_definition(name, text):
    """Of each type: fields with their type, and the constants of each enumeration, from the ros1msg text alone."""
    types = {}
    parts = text.split(SEPARATOR + "\n")
    for index, part in enumerate(parts):
        lines = part.split("\n")
        type_name = name
        if index:
            assert lines[0].startswith("MSG: "), lines[0]
            type_name = lines.pop(0).removeprefix("MSG: ").strip()
        types[type_name] = parse_section(lines)
    return types


def parse_section(lines):
    fields, enumerations, comments, current = [], {}, [], None
    for line in lines:
        line = line.strip()
        if not line:
            comments, current = [], None
        elif line.startswith("#"):
            comments.append(line[1:].strip())
        elif constant := re.fullmatch(r"(\w+) (\w+)=(\d+)\s*(#.*)?", line):
            if current is None:
                current = enumerations.setdefault(comments[0].split(":")[0], {})
            current[constant[2]] = int(constant[3])
            comments = []
        else:
            field = re.fullmatch(r"([\w/]+)(\[\d*\])? (\w+)", line)
            assert field, line
            values_of = re.search(r"values of (\w+)", comments[-1]) if comments else None
            fields.append((field[3], field[1], field[2], values_of and values_of[1]))
            comments, current = [], None
    if len(enumerations) > 1:
        for name, constants in enumerations.items():
            prefix = re.sub(r"(?<!^)(?=[A-Z])", "_", name).upper() + "_"
            enumerations[name] = {key.removeprefix(prefix): value for key, value in constants.items()}
    return fields, enumerations


class Comparison:
    """Walks a definition, and in step with it echo's JSON and a reader's object."""

    def __init__(self):
        self.values = 0
        self.depth_path = ""

    def message(self, types, type_name, told, read, path):
        fields, enumerations = types[type_name]
        assert list(told) == [field[0] for field in fields], (path, list(told))
        for name, base, repeated, values_of in fields:
            names = enumerations[values_of] if values_of else None
            self.field(types, base, repeated, names, told[name], getattr(read, name), f"{path}.{name}")

    def field(self, types, base, repeated, names, told, read, path):
        if repeated is None:
            self.value(types, base, names, told, read, path)
            return
        assert len(told) == len(read), (path, len(told), len(read))
        for index, (one, other) in enumerate(zip(told, read)):
            self.value(types, base, names, one, other, f"{path}.{index}")

    def value(self, types, base, names, told, read, path):
        if base in types:
            self.message(types, base, told, read, path)
            return
        self.values += 1
        if names is not None:
            told = names[told]
        if base == "time":
            sec = getattr(read, "secs", None) if hasattr(read, "secs") else read.sec
            nsec = getattr(read, "nsecs", None) if hasattr(read, "nsecs") else read.nanosec
            assert (told["sec"], told["nsec"]) == (sec, nsec), (path, told, read)
        elif base == "float32":
            assert struct.pack("<f", told) == struct.pack("<f", read), (path, told, read)
        elif base == "float64":
            assert struct.pack("<d", told) == struct.pack("<d", read), (path, told, read)
        elif base == "bool":
            assert told is bool(read), (path, told, read)
        elif base == "string":
            assert told == read, (path, told, read)
        else:
            number = read[0] if isinstance(read, bytes) else int(read)
            assert isinstance(told, int) and told == number, (path, told, read)


def ros2_topic(topic):
    return "/" + re.sub(r"[^A-Za-z0-9/]", "_", topic)


def echoed(path):
    """What `arena echo` printed, by topic, in order."""
    lines = defaultdict(list)
    with open(path) as file:
        for line in file:
            message = json.loads(line)
            assert "error" not in message, message
            lines[message["topic"]].append(message)
    return lines


def definitions(recording):
    with open(recording, "rb") as file:
        summary = make_reader(file).get_summary()
    found = {}
    for channel in summary.channels.values():
        schema = summary.schemas[channel.schema_id]
        assert (channel.message_encoding, schema.encoding) == ("ros1", "ros1msg"), channel.topic
        found[channel.topic] = (schema.name, schema.data.decode())
    return found


def check(title, told, known, messages):
    """`messages` gives topic, log time, publish time or None, and the reader's object, in order for each topic."""
    comparison, counts = Comparison(), defaultdict(int)
    parsed = {topic: (name, parse_definition(name, text)) for topic, (name, text) in known.items()}
    for topic, log_time, publish_time, read in messages:
        index = counts[topic]
        counts[topic] += 1
        line = told[topic][index]
        assert line["at_ns"] == log_time, (title, topic, index, line["at_ns"], log_time)
        assert publish_time is None or line["published_at_ns"] == publish_time, (title, topic, index)
        name, types = parsed[topic]
        assert line["type"] == name, (title, topic, line["type"], name)
        comparison.message(types, name, line["body"], read, f"{title}: {topic} {index}: {name}")
    expected = {topic: len(lines) for topic, lines in told.items()}
    assert dict(counts) == expected, (title, {t: (counts[t], n) for t, n in expected.items() if counts[t] != n})
    print(f"{title}: {sum(counts.values())} messages of {len(counts)} topics, {comparison.values} values: all equal")


def with_mcap(path, decoder, topics):
    with open(path, "rb") as file:
        reader = make_reader(file, decoder_factories=[decoder()])
        for _, channel, message, read in reader.iter_decoded_messages():
            yield topics.get(channel.topic, channel.topic), message.log_time, message.publish_time, read


def with_typestore(path, known):
    store = get_typestore(Stores.EMPTY)
    names = {}
    for name, text in set(known.values()):
        names[name] = name.replace("/", "/msg/")
        store.register(get_types_from_msg(text, names[name]))
    with open(path, "rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            read = store.deserialize_ros1(message.data, names[schema.name])
            yield channel.topic, message.log_time, message.publish_time, read


def with_any_reader(path, topics):
    with AnyReader([Path(path)]) as reader:
        for connection, at, data in reader.messages():
            yield topics[connection.topic], at, None, reader.deserialize(data, connection.msgtype)


def main():
    recording, ros2, echo, export = sys.argv[1:]
    told, known = echoed(echo), definitions(recording)
    assert sum(map(len, told.values())) > 0, "the recording is empty"
    assert told == echoed(export), "arena export --json differs from arena echo --json"
    topics = {ros2_topic(topic): topic for topic in told}
    check("mcap-ros1-support", told, known, with_mcap(recording, Ros1Decoder, {}))
    check("rosbags typestore", told, known, with_typestore(recording, known))
    check("mcap-ros2-support", told, known, with_mcap(ros2, Ros2Decoder, topics))
    check("rosbags AnyReader", told, known, with_any_reader(ros2, topics))


if __name__ == "__main__":
    main()
