"""Lines of mjbots' adapters: vectors from the documentation, and the host's own package in both directions."""

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from moteus import fdcanusb_device as theirs

from norton_drivers.codecs import fdcanusb
from norton_drivers.codecs.can_frames import FD_LENGTHS
from norton_drivers.codecs.common import CodecError, crc8_97
from norton_drivers.codecs.fdcanusb import FdcanusbFrame

# moteus, docs/protocol/can.md, "Example".
COMMAND = bytes.fromhex("01000a07206000200150ff140400130d")
REPLY = bytes.fromhex("2404000a005000000170ff230d181400")


@st.composite
def frames(draw: st.DrawFn) -> FdcanusbFrame:
    fd, extended = draw(st.booleans()), draw(st.booleans())
    remote = not fd and draw(st.booleans())
    length = draw(st.sampled_from(FD_LENGTHS[1:] if fd else range(1, 9)))
    data = b"" if remote else draw(st.binary(min_size=length, max_size=length))
    identifier = draw(st.integers(0, 0x1FFFFFFF if extended else 0x7FF))
    return FdcanusbFrame(identifier, data, length, extended, remote, fd, fd and draw(st.booleans()))


def test_the_example_of_the_documentation():
    sent = FdcanusbFrame.decode_command(b"can send 8001 " + COMMAND.hex().encode())
    assert sent == FdcanusbFrame(0x8001, COMMAND, 16, extended=True, fd=True, switched=True)
    received = FdcanusbFrame.decode_event(b"rcv 100 " + REPLY.hex().encode())
    assert received == FdcanusbFrame(0x100, REPLY, 16, fd=True)
    with_flags = FdcanusbFrame.decode_event(b"rcv 100 " + REPLY.hex().upper().encode() + b" E B F r t1234 f-1")
    assert with_flags == FdcanusbFrame(0x100, REPLY, 16, extended=True, fd=True, switched=True)


@given(frames())
def test_both_directions(frame):
    assert FdcanusbFrame.decode_command(frame.encode_command()) == frame
    assert FdcanusbFrame.decode_event(frame.encode_event()) == frame


@given(frames())
def test_the_hosts_own_package_reads_what_our_adapter_says(frame):
    read = theirs.FdcanusbDevice._parse_frame(None, frame.encode_event())
    assert read.arbitration_id == frame.arbitration_id
    assert read.data == (bytes(frame.length) if frame.remote else frame.data)
    assert (read.is_extended_id, read.is_fd, read.bitrate_switch) == (frame.extended, frame.fd, frame.switched)


@given(st.binary(max_size=80).filter(lambda line: b"*" not in line))
def test_checksums_are_theirs(line):
    assert crc8_97(line) == theirs._compute_crc8(line)
    assert fdcanusb.with_checksum(line) == theirs._append_checksum(line)
    assert fdcanusb.checked(theirs._append_checksum(line)) == line.rstrip(b" ")
    assert fdcanusb.checked(line) == line


def test_a_wrong_checksum_is_told():
    with pytest.raises(CodecError, match="wrong checksum"):
        fdcanusb.checked(b"OK *00")


@pytest.mark.parametrize(
    "line",
    [
        b"",
        b"can send 8001",
        b"can send 8001 0",
        b"can send 8001 zz",
        b"can send 40000000 00",
        b"can std 800 00 f",
        b"can send 100 000102030405060708 f",
        b"can send 100 " + b"00" * 9,
        b"can send 100 00 X",
        b"can send 8001 " + b"00" * 65,
        b"xcan send 100 00",
    ],
)
def test_what_is_no_frame_to_send(line):
    with pytest.raises(CodecError):
        FdcanusbFrame.decode_command(line)


@pytest.mark.parametrize("line", [b"", b"rcv", b"rcv 100", b"rcv 100 0 e", b"rcv 20000000 00 E", b"rcv 1 00 q"])
def test_what_is_no_frame_received(line):
    with pytest.raises(CodecError):
        FdcanusbFrame.decode_event(line)


def test_a_frame_without_data_cannot_be_sent_but_received():
    with pytest.raises(CodecError, match="sends no frame without data"):
        FdcanusbFrame(0x80, b"", 0).encode_command()
    assert FdcanusbFrame.decode_event(b"rcv 80  e b f r f-1") == FdcanusbFrame(0x80, b"", 0)


@given(st.lists(frames(), max_size=4), st.binary(max_size=60), st.lists(st.integers(0, 600), max_size=5))
def test_any_cut_gives_the_same_lines(sent, junk, cuts):
    data = junk + b"\r\n" + b"".join(frame.encode_event() + b"\r\n" for frame in sent)
    places = [0, *sorted(min(cut, len(data)) for cut in cuts), len(data)]
    stream = fdcanusb.line_stream()
    lines = [line.text for a, b in pairwise(places) for line in stream.feed(data[a:b])]
    assert lines[len(lines) - len(sent) :] == [frame.encode_event() for frame in sent]


def test_status_in_words():
    # fdcanusb, can_manager.cc, Command_Status.
    status = fdcanusb.status_in(b"lec=3 dlec=7 err=1 warn=1 busoff=1 pexc=0 tdc=12")
    assert status is not None
    assert fdcanusb.status_words(status) == (
        "no acknowledgement", "error-passive", "error warning level reached", "bus-off",
    )  # fmt: skip
    assert fdcanusb.status_in(fdcanusb.encode_status(status)) == status
    assert fdcanusb.status_in(b"OK") is None


def test_settings_both_ways():
    assert fdcanusb.setting("can.fd_bitrate", 5_000_000) == b"conf set can.fd_bitrate 5000000"
    assert fdcanusb.setting_in(b"conf set can.fd_bitrate 5000000") == ("can.fd_bitrate", "5000000")
    assert fdcanusb.setting_in(b"conf get can.fd_bitrate") is None
