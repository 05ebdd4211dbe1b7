"""Dynamixel Protocol 2.0 against the examples of ROBOTIS' e-Manual, and against their own library."""

import pytest
from crccheck.crc import Crc16Buypass
from dynamixel_sdk.group_sync_read import GroupSyncRead
from dynamixel_sdk.group_sync_write import GroupSyncWrite
from dynamixel_sdk.protocol2_packet_handler import Protocol2PacketHandler
from hypothesis import given, settings
from hypothesis import strategies as st

from norton_drivers.codecs import dynamixel as protocol
from norton_drivers.codecs.common import CodecError, crc16_8005
from norton_drivers.codecs.dynamixel import AnswerStream, Dialect, Instruction, Packet, PacketStream
from norton_drivers.codecs.half_duplex import Answer
from tests.drivers.codecs.scripted_line import ScriptedLine

NODES = st.integers(0, protocol.NODE_MAX)
# Bytes among which what must be stuffed is likely.
DATA = st.lists(st.sampled_from(b"\xff\xfd\x00\x01\x7f"), max_size=24).map(bytes) | st.binary(max_size=24)
PACKETS = st.builds(Packet, NODES, st.sampled_from([0x01, 0x02, 0x03, 0x55, 0x82, 0x83]), DATA)
JUNK = st.lists(st.sampled_from(b"\xff\xfd\x00\x10"), max_size=12).map(bytes) | st.binary(max_size=12)
HANDLER = Protocol2PacketHandler()

# e-Manual, "DYNAMIXEL Protocol 2.0", section 5: Ping, Read, Write, Sync Read, Sync Write, Reboot.
EXAMPLES = {
    "FF FF FD 00 01 03 00 01 19 4E": Dialect().ping(1),
    "FF FF FD 00 01 07 00 55 00 06 04 26 65 5D": protocol.status(1, 0, bytes.fromhex("060426")),
    "FF FF FD 00 01 07 00 02 84 00 04 00 1D 15": Dialect().read(1, 132, 4),
    "FF FF FD 00 01 09 00 03 74 00 00 02 00 00 CA 89": protocol.write(1, 116, (512).to_bytes(4, "little")),
    "FF FF FD 00 FE 09 00 82 84 00 04 00 01 02 CE FA": Dialect().sync_read(132, 4, [1, 2]),
    "FF FF FD 00 FE 11 00 83 74 00 04 00 01 96 00 00 00 02 AA 00 00 00 82 87": Dialect().sync_write(
        116, {1: (150).to_bytes(4, "little"), 2: (170).to_bytes(4, "little")}
    ),
    "FF FF FD 00 01 03 00 08 2F 4E": protocol.reboot(1),
}


@pytest.mark.parametrize("example", EXAMPLES)
def test_the_makers_examples(example: str) -> None:
    assert EXAMPLES[example] == bytes.fromhex(example)


@given(st.binary(max_size=64))
def test_the_crc_against_another_implementation(data: bytes) -> None:
    assert crc16_8005(data) == Crc16Buypass.calc(data)


@given(PACKETS)
def test_bytes_are_stuffed_as_the_makers_library_does(packet: Packet) -> None:
    plain = [*protocol.HEADER, packet.node, len(packet.parameters) + 3, 0, packet.instruction, *packet.parameters, 0, 0]
    stuffed = HANDLER.addStuffing(list(plain))
    encoded = packet.encode()
    length = int.from_bytes(encoded[5:7], "little")
    assert bytes(stuffed[: length + 5]) == encoded[:-2]
    assert HANDLER.removeStuffing(list(encoded))[7:-2][: len(packet.parameters) + 1] == [
        packet.instruction,
        *packet.parameters,
    ]


@given(st.lists(PACKETS, min_size=1, max_size=3), JUNK)
def test_every_packet_is_found_however_the_stream_is_cut(packets: list[Packet], junk: bytes) -> None:
    # A header in the junk may promise a packet: what its length covers is found when that has proved wrong.
    stream, cut = PacketStream(64), PacketStream(64)
    sent = junk + b"".join(packet.encode() for packet in packets) + bytes(64)
    found = [packet[:3] for packet in stream.feed(sent)]
    assert [packet[:3] for byte in sent for packet in cut.feed(bytes((byte,)))] == found
    assert found == [packet[:3] for packet in packets]
    assert (cut.discarded_bytes, cut.bad_checksums) == (stream.discarded_bytes, stream.bad_checksums)


@given(st.binary(max_size=400))
def test_noise_is_no_packet(noise: bytes) -> None:
    stream = PacketStream()
    assert stream.feed(noise) == []
    stream.drop()
    assert stream.discarded_bytes == len(noise)


@settings(max_examples=40)
@given(st.dictionaries(NODES, st.binary(min_size=4, max_size=4), min_size=1, max_size=4), st.booleans())
def test_the_makers_library_reads_our_answers_and_we_theirs(values: dict[int, bytes], fast: bool) -> None:
    """Sync Read and Fast Sync Read: their question, our answer, their reading of it."""
    nodes = list(values)
    if fast:
        answer = b""
        for node in nodes:
            answer += protocol.fast_block(Answer(node, 0, values[node]), answer, len(nodes))
    else:
        answer = b"".join(protocol.status(node, 0, values[node]) for node in nodes)
    line = ScriptedLine(answer)
    group = GroupSyncRead(line, HANDLER, 132, 4)
    for node in nodes:
        group.addParam(node)
    assert (group.fastSyncRead() if fast else group.txRxPacket()) == 0
    assert {node: bytes(group.data_dict[node]) for node in nodes} == values
    ours = Dialect()
    ours.fast = fast
    assert line.written == ours.sync_read(132, 4, nodes)
    stream = ours.answers()
    assert [found[:3] for found in stream.feed(answer)] == [(node, 0, values[node]) for node in nodes]


def test_goals_are_written_as_the_makers_library_writes_them() -> None:
    line, values = ScriptedLine(b""), {1: b"\x2c\x01", 200: b"\xd4\xfe"}
    group = GroupSyncWrite(line, HANDLER, 102, 2)
    for node, value in values.items():
        group.addParam(node, list(value))
    group.txPacket()
    assert line.written == Dialect().sync_write(102, values)


def test_where_each_servos_part_of_a_fast_answer_ended() -> None:
    first = protocol.fast_block(Answer(3, 0, bytes(4)), b"", 2)
    second = protocol.fast_block(Answer(7, 0x80, bytes(4)), first, 2)
    stream = AnswerStream()
    stream.fast_length = 4
    assert [(found.node, found.error, found.later_bytes) for found in stream.feed(first + second + b"\xff")] == [
        (3, 0, len(second) + 1),
        (7, 0x80, 1),
    ]
    assert protocol.fast_bytes(4, 2) == len(first + second)
    stream.fast_length = 5  # as many bytes as nobody asked for
    assert stream.feed(first + second) == []


@pytest.mark.parametrize(
    "packet", [Packet(256, Instruction.PING), Packet(1, -1), Packet(1, 300), Packet(1, 3, bytes(1020))]
)
def test_what_no_packet_can_carry_is_refused(packet: Packet) -> None:
    with pytest.raises(CodecError):
        packet.encode()
