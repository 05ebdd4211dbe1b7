"""Frames and bytes as they should not be: random ones, and good ones with something done to them."""

from random import Random

import can

_DATA_MAX, _FD_DATA_MAX = 8, 64


def random_frame(random: Random, identifiers: tuple[int, ...], *, fd: bool = False) -> can.Message:
    """Any frame; every other one has an identifier that somebody listens to."""
    extended = random.random() < 0.5
    identifier = random.choice(identifiers) if random.random() < 0.5 else random.getrandbits(29 if extended else 11)
    data = random.randbytes(random.randint(0, _FD_DATA_MAX if fd else _DATA_MAX))
    return _frame(identifier, data, extended or identifier > 0x7FF, random, fd)


def damaged_frame(frame: can.Message, random: Random) -> can.Message:
    """The frame with flipped bits, cut short, longer, or under another identifier; one in four as it was."""
    data, identifier = bytearray(frame.data), frame.arbitration_id
    match random.randrange(4):
        case 0:
            data = damaged(data, random)[: _FD_DATA_MAX if frame.is_fd else _DATA_MAX]
        case 1:
            identifier ^= 1 << random.randrange(29 if frame.is_extended_id else 11)
        case 2:
            return _frame(identifier, bytes(data), not frame.is_extended_id or identifier > 0x7FF, random, frame.is_fd)
    return _frame(identifier, bytes(data), frame.is_extended_id, random, frame.is_fd)


def _frame(identifier: int, data: bytes, extended: bool, random: Random, fd: bool) -> can.Message:
    remote = random.random() < 0.02 and not fd
    return can.Message(
        arbitration_id=identifier,
        is_extended_id=extended,
        is_remote_frame=remote,
        dlc=len(data),
        data=None if remote else data,
        is_fd=fd,
    )


def damaged(data: bytes | bytearray, random: Random) -> bytearray:
    """A few bits flipped, bytes lost, put in, changed, or a piece cut out."""
    made = bytearray(data)
    for _ in range(random.choice((1, 1, 1, 2, 3))):
        at = random.randrange(len(made) + 1)
        match random.randrange(5):
            case 0 if at < len(made):
                made[at] ^= 1 << random.randrange(8)
            case 1 if at < len(made):
                made[at] = random.getrandbits(8)
            case 2:
                made.insert(at, random.getrandbits(8))
            case 3:
                del made[at : at + 1]
            case _:
                del made[at : at + random.randint(1, 6)]
    return made
