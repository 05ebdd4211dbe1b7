"""The one master of a half-duplex line: who is asked, and when the line is free.

In a cycle the goals of all driving servos go out in one write, together with the question for the readings of all.
While an answer is awaited nothing else is sent; where one does not come in time, goals go out alone, and after a
timeout the servos are asked anew. After several cycles without an answer each is asked for itself for a while: one that
has fallen silent keeps those behind it in a Sync Read from answering.

While a servo drives, nothing but its commands causes a packet: its watchdog counts packets of any kind.
"""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from norton_drivers.codecs.half_duplex import Answer, Dialect
from norton_drivers.half_duplex.line import LineTiming, Registers, Share, read_together, together
from norton_drivers.link import Link
from norton_drivers.ports import SerialPort

# Servos that do not drive are asked as often as this, and those whose watchdog is being tested, once it should have
# acted.
IDLE_NS, TESTED_NS = 5_000_000, 20_000_000
# The others wait in vain each time that one is asked that is silent. It is asked again after this share of the time for
# which it has been silent, and at least so often: with timeouts of 9 ms after 9, 22, 42 and 72 ms, so that one that was
# only late is heard before it is taken for lost after 100 ms.
SILENT_SHARE, SILENT_NS = 0.5, 100_000_000
# Answers that are later than the adapter's latency by this are lost.
TIMEOUT_NS = 8_000_000
MISSED_MOST = 2
APART_NS = 1_000_000_000


class Member(Protocol):
    """A servo on the line, as the master knows it."""

    @property
    def share(self) -> Share: ...

    @property
    def readable(self) -> bool:
        """Whether its registers are set up to be read in a cycle."""
        ...

    @property
    def driving(self) -> bool:
        """Whether a goal is commanded in every cycle."""
        ...

    @property
    def quiet_until_ns(self) -> int:
        """Until then nothing at all may be sent: 0 where anything may."""
        ...

    def take(self, answer: Answer, stamp_ns: int) -> None:
        """Its readings have come, at this instant."""
        ...


@dataclass
class Pending:
    """A question outside the cycle."""

    answer: Answer | None = None
    done: bool = False


@dataclass
class _Exchange:
    """What is sent at once, and who answers, in this order, with how many bytes of data."""

    sent: bytes
    of: Sequence[tuple[int, float]]  # id, return delay [s]
    length: int
    took: Callable[[Answer, int], None]
    ended: Callable[[bool], None] = lambda _complete: None


@dataclass
class _Awaited:
    """An exchange under way."""

    exchange: _Exchange
    expected_ns: dict[int, int]  # the last byte of each answer, with no time spent in the adapter
    free_ns: int  # from then on the line is free, whether they came or not
    lost_ns: int
    missing: set[int] = field(init=False)
    overdue: bool = False

    def __post_init__(self) -> None:
        self.missing = set(self.expected_ns)


class BusMaster:
    """One line. ``answered`` and ``unanswered`` count exchanges, ``unexpected`` answers that nobody waited for."""

    def __init__(self, port: SerialPort, link: Link, dialect: Dialect, timing: LineTiming) -> None:
        self.dialect = dialect
        self.timing = timing
        self.answered = self.unanswered = self.unexpected = 0
        self._port = port
        self._clock = link.clock
        self._link = link
        self._answers = dialect.answers()
        self._members: list[Member] = []
        self._goals: dict[int, bytes] = {}
        self._questions: deque[_Exchange] = deque()
        self._awaited: _Awaited | None = None
        self._cycle_ns = 0  # when the last one began
        self._question_next = False  # goals may come faster than the line is free: questions have every other turn
        self._missed = 0  # cycles in a row that were not answered completely
        self._apart_until_ns = 0
        self._turn = 0
        self._silent_until_ns: dict[int, int] = {}
        self._heard_ns: dict[int, int] = {}
        port.subscribe(self._on_bytes)
        link.questions.append(self._look)

    @property
    def name(self) -> str:
        return self._port.name

    def join(self, member: Member) -> None:
        """From now on it has its share of every cycle."""
        self._members.append(member)

    # ---- What the drivers ask ------------------------------------------------------------------------------------

    def command(self, member: Member, goal: bytes) -> None:
        """Send a goal: together with those of the other driving servos, or at the next poll without them.

        Raises ConnectionFailedError.
        """
        self._goals[member.share.node] = goal
        if all(other.share.node in self._goals for other in self._members if other.driving):
            self._begin_cycle()

    def write(self, address: int, node: int, data: bytes) -> None:
        """Write registers, which nobody answers. Raises ConnectionFailedError."""
        self._questions.append(_Exchange(self.dialect.sync_write(address, {node: data}), (), 0, _nobody))
        self._begin_question()

    def stop(self, node: int, writes: Sequence[tuple[int, bytes]]) -> None:
        """Write these registers at once, whoever may be speaking, and again once the line is free.

        Raises ConnectionFailedError.
        """
        self._goals.pop(node, None)
        packets = b"".join(self.dialect.sync_write(address, {node: data}) for address, data in writes)
        self._questions.appendleft(_Exchange(packets, (), 0, _nobody))
        self._port.send(packets)

    def reboot(self, packet: bytes) -> None:
        """Send this, to which a servo answers before it is gone for a while; its answer is not waited for.

        Raises ConnectionFailedError.
        """
        self._questions.append(_Exchange(packet, (), 0, _nobody))
        self._begin_question()

    def finish(self, deadline_ns: int) -> None:
        """Wait until nothing is awaited any more. Raises ConnectionFailedError."""
        while self._awaited is not None and self._clock.now_ns() < deadline_ns:
            self._link.wait()

    def ask(self, question: bytes, node: int, length: int, return_delay_s: float) -> Pending:
        """Put a question outside the cycle. Raises ConnectionFailedError."""
        pending = Pending()

        def took(answer: Answer, _stamp_ns: int) -> None:
            pending.answer = answer

        def ended(_complete: bool) -> None:
            pending.done = True

        self._questions.append(_Exchange(question, ((node, return_delay_s),), length, took, ended))
        self._begin_question()
        return pending

    # ---- The line ------------------------------------------------------------------------------------------------

    def _look(self) -> None:
        """Called before every poll."""
        now_ns = self._clock.now_ns()
        self._give_up_late(now_ns)
        if self._goals:
            self._begin_cycle()
        if now_ns < max((member.quiet_until_ns for member in self._members), default=0):
            return
        self._begin_question()
        driving = [member for member in self._members if member.driving]
        tested = all(member.quiet_until_ns for member in driving)
        period_ns = TESTED_NS if driving else IDLE_NS
        if tested and self._awaited is None and now_ns - self._cycle_ns >= period_ns:
            self._begin_cycle()

    def _begin_question(self) -> bool:
        """Whether an answer is awaited from now on."""
        while self._questions and self._awaited is None:
            self._send(self._questions.popleft())
        return self._awaited is not None

    def _begin_cycle(self) -> None:
        """The goals that are there, and the question for all readings where the line is free for the answers."""
        now_ns = self._clock.now_ns()
        if self._awaited is not None and now_ns < self._awaited.free_ns:
            return
        if self._question_next and self._awaited is None:
            self._question_next = False
            if self._begin_question():
                return  # the goals follow as soon as the line is free
        self._question_next = True
        goals = b"".join(
            self.dialect.sync_write(part[0].goal.address, {share.node: self._goals[share.node] for share in part})
            for part in together([m.share for m in self._members if m.share.node in self._goals], _goal_of)
        )
        self._goals.clear()
        self._cycle_ns = now_ns
        if self._awaited is not None:
            self._port.send(goals)
            return
        exchanges = list(self._readings(now_ns))
        if not exchanges:
            self._port.send(goals)
            return
        exchanges[0].sent = goals + exchanges[0].sent
        self._questions.extendleft(reversed(exchanges[1:]))
        self._send(exchanges[0])

    def _readings(self, now_ns: int) -> list[_Exchange]:
        readable = [member.share for member in self._members if member.readable]
        if not readable:
            return []
        if now_ns < self._apart_until_ns:
            return self._reading_apart(readable, now_ns)
        return [
            self._reading(
                self.dialect.sync_read(part[0].reading.address, part[0].reading.length, [share.node for share in part]),
                part,
                self._note_cycle,
            )
            for part in read_together(self.dialect, readable)
        ]

    def _reading_apart(self, readable: Sequence[Share], now_ns: int) -> list[_Exchange]:
        """That of one servo, in turn; those that do not answer are asked seldom."""
        ready = [share for share in readable if now_ns >= self._silent_until_ns.get(share.node, 0)]
        if not ready:
            return []
        self._turn += 1
        share = ready[self._turn % len(ready)]

        def ended(complete: bool) -> None:
            now_ns = self._clock.now_ns()
            pause_ns = min(round(SILENT_SHARE * (now_ns - self._heard_ns.get(share.node, 0))), SILENT_NS)
            self._silent_until_ns[share.node] = 0 if complete else now_ns + pause_ns

        question = self.dialect.read(share.node, share.reading.address, share.reading.length)
        return [self._reading(question, [share], ended)]

    def _reading(self, question: bytes, part: Sequence[Share], ended: Callable[[bool], None]) -> _Exchange:
        of = [(share.node, share.return_delay_s) for share in part]
        return _Exchange(question, of, part[0].reading.length, self._take, ended)

    def _note_cycle(self, complete: bool) -> None:
        self._missed = 0 if complete else self._missed + 1
        if self._missed >= MISSED_MOST:
            self._missed, self._apart_until_ns = 0, self._clock.now_ns() + APART_NS

    def _send(self, exchange: _Exchange) -> None:
        now_ns = self._clock.now_ns()
        if exchange.of:
            at_s = self.timing.wire_s(len(exchange.sent))
            expected: dict[int, int] = {}
            for node, return_delay_s in exchange.of:
                at_s += return_delay_s + self.timing.wire_s(self.dialect.overhead + exchange.length)
                expected[node] = now_ns + round(at_s * 1e9)
            free_ns = now_ns + round((at_s + self.timing.latency_s) * 1e9)
            self._awaited = _Awaited(exchange, expected, free_ns, free_ns + TIMEOUT_NS)
            self._answers.drop()
        self._port.send(exchange.sent)

    def _give_up_late(self, now_ns: int) -> None:
        awaited = self._awaited
        if awaited is None or now_ns < awaited.lost_ns:
            return
        if not awaited.overdue:
            # This computer may have stood still, with the answer waiting in its buffers: the ports come first.
            awaited.overdue = True
            return
        self._end(awaited, complete=False)

    def _end(self, awaited: _Awaited, *, complete: bool) -> None:
        self._awaited = None
        self.answered += complete
        self.unanswered += not complete
        awaited.exchange.ended(complete)

    def _on_bytes(self, data: bytes, arrival_ns: int) -> None:
        for answer in self._answers.feed(data):
            self._on_answer(answer, arrival_ns)

    def _on_answer(self, answer: Answer, arrival_ns: int) -> None:
        awaited = self._awaited
        whole = awaited is not None and (len(answer.data) == awaited.exchange.length or not answer.data)
        if awaited is None or answer.node not in awaited.missing or not whole:
            self.unexpected += 1
            return
        awaited.missing.discard(answer.node)
        # When its last byte was here: not after it was read, nor later than the adapter may take.
        soonest_ns = awaited.expected_ns[answer.node]
        latest_ns = soonest_ns + round(self.timing.latency_s * 1e9)
        came_ns = arrival_ns - round(self.timing.wire_s(answer.later_bytes) * 1e9)
        awaited.exchange.took(answer, min(came_ns, latest_ns))
        if not awaited.missing:
            self._end(awaited, complete=True)
            if self._goals and self._clock.now_ns() >= self._cycle_ns + 1:
                self._begin_cycle()
            self._begin_question()

    def _take(self, answer: Answer, stamp_ns: int) -> None:
        self._heard_ns[answer.node] = stamp_ns
        for member in self._members:
            if member.share.node == answer.node:
                member.take(answer, stamp_ns)


def _goal_of(share: Share) -> Registers:
    return share.goal


def _nobody(_answer: Answer, _stamp_ns: int) -> None:
    """Nobody answers."""
