"""Feetech's protocol against their own library, in both directions."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scservo_sdk import scservo_def
from scservo_sdk.group_sync_read import GroupSyncRead
from scservo_sdk.group_sync_write import GroupSyncWrite
from scservo_sdk.protocol_packet_handler import protocol_packet_handler

from norton_drivers.codecs import feetech as protocol
from norton_drivers.codecs.common import CodecError
from norton_drivers.codecs.feetech import Dialect, Packet, PacketStream, signed, with_sign
from tests.drivers.codecs.scripted_line import ScriptedLine

NODES = st.integers(0, protocol.NODE_MAX)
DATA = st.lists(st.sampled_from(b"\xff\x00\x02\x7f"), max_size=16).map(bytes) | st.binary(max_size=16)
PACKETS = st.builds(Packet, NODES, st.integers(0, 0x7F), DATA)
HANDLER = protocol_packet_handler()


@given(NODES, st.integers(0, 255), st.binary(min_size=1, max_size=31), st.integers(0, 0x7F))
def test_they_read_our_answers_and_ask_as_we_do(node: int, address: int, data: bytes, error: int) -> None:
    answer = Packet(node, error, data).encode()
    line = ScriptedLine(answer)
    read, result, said = HANDLER.readTxRx(line, node, address, len(data))
    assert (bytes(read), result, said) == (data, 0, error)
    ours = Dialect()
    assert line.written == ours.read(node, address, len(data))
    assert [found[:3] for found in ours.answers().feed(answer)] == [(node, error, data)]


@settings(max_examples=40)
@given(st.dictionaries(NODES, st.binary(min_size=2, max_size=2), min_size=1, max_size=4))
def test_several_at_once(values: dict[int, bytes]) -> None:
    answer = b"".join(Packet(node, 0, data).encode() for node, data in values.items())
    line = ScriptedLine(answer)
    group = GroupSyncRead(line, HANDLER, 56, 2)
    for node in values:
        group.addParam(node)
    assert group.txRxPacket() == 0
    assert {node: bytes(data) for node, data in group.data_dict.items()} == values
    assert line.written == Dialect().sync_read(56, 2, list(values))
    line = ScriptedLine(b"")
    goals = GroupSyncWrite(line, HANDLER, 42, 2)
    for node, data in values.items():
        goals.addParam(node, list(data))
    goals.txPacket()
    assert line.written == Dialect().sync_write(42, values)


def test_one_after_another_where_there_is_no_sync_read() -> None:
    assert Dialect(reads_together=False).sync_read(56, 8, [5]) == Dialect().read(5, 56, 8)


@given(st.lists(PACKETS, min_size=1, max_size=3), st.binary(max_size=8))
def test_what_is_found_does_not_depend_on_how_the_stream_is_cut(packets: list[Packet], junk: bytes) -> None:
    stream, cut = PacketStream(), PacketStream()
    sent = junk + b"".join(packet.encode() for packet in packets) + bytes(300)
    found = [packet[:3] for packet in stream.feed(sent)]
    assert [packet[:3] for byte in sent for packet in cut.feed(bytes((byte,)))] == found
    if b"\xff" not in junk:
        assert found[: len(packets)] == [packet[:3] for packet in packets]
    assert (cut.discarded_bytes, cut.bad_checksums) == (stream.discarded_bytes, stream.bad_checksums)


def test_the_echo_of_a_question_is_no_answer() -> None:
    """An adapter that joins its two wires hears itself: a question to a servo looks like that servo's answer."""
    dialect = Dialect()
    echo = dialect.ping(3)
    assert dialect.answers().feed(echo + Packet(3, 0).encode()) == [(3, 0, b"", 0)]
    assert dialect.answers().feed(dialect.sync_write(42, {3: b"\0\0"})) == []


@given(st.integers(-1023, 1023))
def test_signs_are_theirs(value: int) -> None:
    assert with_sign(value, 10) == scservo_def.SCS_TOSCS(value, 10)
    assert signed(with_sign(value, 10), 10) == scservo_def.SCS_TOHOST(with_sign(value, 10), 10) == value


def test_what_cannot_be_carried_is_refused() -> None:
    for wrong in (Packet(300, 1), Packet(1, 256), Packet(1, 3, bytes(245))):
        with pytest.raises(CodecError):
            wrong.encode()
    with pytest.raises(CodecError):
        with_sign(1024, 10)
    assert protocol.describe_error(0b100101) == ("supply voltage out of its limits", "overheating", "overload")
