"""Linear operators of one output, improper ones included: a state-space system and a polynomial in d/dt.

    ẇ = A w + B u,      y = C w + D₀ u + D₁ u̇ + D₂ ü + …

An impedance with inertia is improper: exertion follows the second derivative of position. Kept apart, the polynomial
makes every operation exact: nothing is approximated by a fast pole, and an inverse is again such an operator.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.linalg import block_diag, matrix_balance, null_space

from norton_bench.arrays import ComplexArray, FloatArray

# A sum is taken for zero where its terms cancel to this part of their size.
CANCELLED = 1e-10
# A row does not meet a column of which it has no more than this part of their sizes.
ROUNDING = 1e-15
# Directions weaker than this, beside the one they come from, are tried to be left out; strongest pruning first.
RANKS = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12)
# Two operators with responses as near as this are one.
SAME = 1e-8
# No mechanism is as fast as this.
FASTEST_RAD_S = 1e12
_NOTHING = (np.zeros((0, 0)), (np.ones(0), None))


@dataclass(frozen=True, eq=False)
class Operator:
    """``state`` A (n, n), ``entry`` B (n, m), ``exit`` C (n,), ``direct`` D (k+1, m), a row for each derivative of u.

    The derivatives of u are taken once: ``direct`` has no rows of zeros at its end, but always the first row.
    """

    state: FloatArray
    entry: FloatArray
    exit: FloatArray
    direct: FloatArray

    @classmethod
    def of(
        cls, state: npt.ArrayLike, entry: npt.ArrayLike, exit_row: npt.ArrayLike, direct: npt.ArrayLike
    ) -> "Operator":
        """From anything like arrays. Raises ValueError, in a sentence, where the shapes do not belong together."""
        d = np.atleast_2d(np.asarray(direct, dtype=float))
        c = np.atleast_1d(np.asarray(exit_row, dtype=float))
        n, m = c.size, d.shape[1]
        try:
            a = np.asarray(state, dtype=float).reshape(n, n)
            b = np.asarray(entry, dtype=float).reshape(n, m)
        except ValueError as error:
            raise ValueError(
                f"with {n} entries in the row of outputs and {m} inputs, A must be {n} by {n} and B {n} by {m}"
            ) from error
        if not all(np.isfinite(part).all() for part in (a, b, c, d)):
            raise ValueError("every entry must be a finite number")
        return cls(a, b, c, _trimmed(d))

    @classmethod
    def polynomial(cls, *coefficients: float) -> "Operator":
        """y = Σ coefficient_k · dᵏu/dtᵏ: stiffness, damping and inertia where u is a position."""
        return cls.of([], [], [], np.array(coefficients, dtype=float).reshape(-1, 1))

    @classmethod
    def gains(cls, *gains: float) -> "Operator":
        """y = Σ gain_i · u_i: one output of several inputs, without dynamics."""
        return cls.of([], [], [], np.array([gains], dtype=float))

    @classmethod
    def rational(cls, numerator: Sequence[float], denominator: Sequence[float]) -> "Operator":
        """A ratio of polynomials in s, highest power first. Raises ValueError where the denominator is zero."""
        below = np.trim_zeros(np.atleast_1d(np.asarray(denominator, dtype=float)), "f")
        if not below.size:
            raise ValueError("the denominator is zero everywhere; give it a coefficient other than zero")
        quotient, remainder = np.polydiv(np.atleast_1d(np.asarray(numerator, dtype=float)), below)
        n = below.size - 1
        state = np.diag(np.ones(max(n - 1, 0)), 1)[:n, :n] if n else np.zeros((0, 0))
        exit_row = np.zeros(n)
        if n:
            state[-1] = -below[:0:-1] / below[0]
            tail = np.asarray(remainder)[::-1][:n] / below[0]
            exit_row[: tail.size] = tail
        return cls.of(state, np.eye(n)[:, -1:] if n else [], exit_row, np.asarray(quotient)[::-1].reshape(-1, 1))

    @property
    def order(self) -> int:
        """The number of states."""
        return int(self.exit.size)

    @property
    def inputs(self) -> int:
        """The number of inputs."""
        return int(self.direct.shape[1])

    @property
    def derivatives(self) -> int:
        """The highest derivative of the input that the output contains; 0 for a proper operator."""
        return int(self.direct.shape[0]) - 1

    def __eq__(self, other: object) -> bool:
        """The same matrices, entry by entry: two realisations of one transfer function are not equal."""
        return isinstance(other, Operator) and all(
            np.array_equal(mine, its) for mine, its in zip(self._parts(), other._parts(), strict=True)
        )

    __hash__ = None  # type: ignore[assignment]

    def _parts(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        return self.state, self.entry, self.exit, self.direct

    def response(self, s: npt.ArrayLike) -> ComplexArray:
        """The transfer function at complex frequencies ``s`` (k,) [rad/s]: shape (k, m)."""
        points = np.atleast_1d(np.asarray(s, dtype=complex))
        columns = [np.polyval(row[::-1], points) for row in self.direct.T]
        value = np.array(columns, dtype=complex).reshape(self.inputs, points.size).T.copy()
        if self.order:
            state, (scale, _) = matrix_balance(self.state, permute=False, separate=True)
            pencils = points[:, None, None] * np.eye(self.order) - state
            entry = np.broadcast_to(self.entry / scale[:, None], (points.size, *self.entry.shape))
            value += (self.exit * scale) @ np.linalg.solve(pencils, entry)
        return np.asarray(value)

    def poles(self) -> ComplexArray:
        """The finite poles [rad/s]."""
        return np.asarray(np.linalg.eigvals(self.state), dtype=complex)

    def zeros(self) -> ComplexArray:
        """The finite zeros [rad/s] of an operator with one input. Raises ZeroDivisionError where it is zero itself."""
        return self.inverse().poles()

    def __neg__(self) -> "Operator":
        return Operator(self.state, self.entry, -self.exit, -self.direct)

    def __add__(self, other: "Operator") -> "Operator":
        """y = self(u) + other(u)."""
        rows = max(self.derivatives, other.derivatives) + 1
        mine, its = _padded(self.direct, rows), _padded(other.direct, rows)
        return Operator(
            block_diag(self.state, other.state) if self.order and other.order else _larger(self.state, other.state),
            np.vstack([self.entry, other.entry]),
            np.concatenate([self.exit, other.exit]),
            _trimmed(_cleared(mine + its, np.abs(mine) + np.abs(its))),
        )

    def __sub__(self, other: "Operator") -> "Operator":
        return self + -other

    def differentiated(self) -> "Operator":
        """y = d/dt self(u), exactly: C B joins the polynomial."""
        through = _cleared(self.exit @ self.entry, np.abs(self.exit) @ np.abs(self.entry))
        return Operator(self.state, self.entry, self.exit @ self.state, _trimmed(np.vstack([through, self.direct])))

    def integrated(self) -> "Operator":
        """y = ∫ self(u) dt, exactly: one pole at zero, none where the polynomial alone can give way."""
        rest = _padded(self.direct[1:], max(self.derivatives, 1))
        if not self.order and not self.direct[0].any():
            return Operator(self.state, self.entry, self.exit, _trimmed(rest))
        n = self.order
        state = np.zeros((n + 1, n + 1))
        state[:n, :n], state[n, :n] = self.state, self.exit
        return Operator(state, np.vstack([self.entry, self.direct[:1]]), np.eye(n + 1)[n], _trimmed(rest))

    def after(self, first: "Operator") -> "Operator":
        """y = self(first(u)): operators in series, ``self`` with one input."""
        # Behind the connection stand v = first(u) and its derivatives; the polynomial of ``first`` drives our states
        # with derivatives of u, which are taken out of the states again.
        n, m = self.order, first.order
        state = np.zeros((n + m, n + m))
        state[:n, :n], state[n:, n:] = self.state, first.state
        state[:n, n:] = np.outer(self.entry[:, 0], first.exit)
        entries = [np.vstack([np.outer(self.entry[:, 0], row), np.zeros((m, first.inputs))]) for row in first.direct]
        entries[0][n:] = first.entry
        own = Operator(np.zeros((0, 0)), np.zeros((0, first.inputs)), np.zeros(0), np.zeros((1, first.inputs)))
        derivative, exit_row = first, np.zeros(n + m)
        exit_row[:n] = self.exit
        for gain in self.direct[:, 0]:
            exit_row[n:] += gain * derivative.exit
            own = own + _polynomial(gain * derivative.direct)
            derivative = derivative.differentiated()
        states = driven(state, entries, exit_row)
        return Operator(states.state, states.entry, states.exit, (states + own).direct)

    def inverse(self) -> "Operator":
        """u from y, for an operator with one input; exact. Raises ZeroDivisionError for one that is zero."""
        if self.derivatives == 0 and self.direct[0, 0] == 0.0:
            return self._inverse_of_strictly_proper()
        # Dk u⁽ᵏ⁾ = y − C w − Σ Di u⁽ⁱ⁾: u and its derivatives below the highest become states.
        n, k = self.order, self.derivatives
        lead = self.direct[k, 0]
        row = -np.concatenate([self.exit, self.direct[:k, 0]]) / lead
        state = np.zeros((n + k, n + k))
        state[:n, :n] = self.state
        entry = np.zeros((n + k, 1))
        if k == 0:
            return Operator(state + self.entry @ row[None, :], self.entry / lead, row, np.array([[1.0 / lead]]))
        state[:n, n] = self.entry[:, 0]
        state[n:-1, n + 1 :] = np.eye(k - 1)
        state[-1], entry[-1] = row, 1.0 / lead
        return Operator(state, entry, np.eye(n + k)[n], np.zeros((1, 1)))

    def _inverse_of_strictly_proper(self) -> "Operator":
        """By the normal form: y and its derivatives take the place of as many states; the rest are the zeros' own."""
        chain, lead = self._chain()
        relative = len(chain)
        above = np.vstack([self.entry.T, *chain[:-1]])
        inner = null_space(_unit_rows(above)).T
        back = np.linalg.inv(np.vstack([*chain, inner]))
        # η̇ = Q η + P (y, ẏ, …), u = (y⁽ʳ⁾ − C Aʳ w)/lead, with w = back (y, ẏ, …, η).
        rates = inner @ self.state @ back
        through = np.abs(chain[-1]) @ np.abs(self.state) @ np.abs(back)
        row = -_cleared(chain[-1] @ self.state @ back, through) / lead
        rest = rates[:, relative:]
        states = driven(rest, [rates[:, i : i + 1] for i in range(relative)], row[relative:])
        own = _polynomial(np.append(row[:relative], 1.0 / lead).reshape(-1, 1))
        return Operator(states.state, states.entry, states.exit, (states + own).direct)

    def _chain(self) -> tuple[list[FloatArray], float]:
        """C, CA, … up to the first that meets B, and how it meets it."""
        row, size, chain = self.exit, np.abs(self.exit), []
        for _ in range(self.order):
            chain.append(row)
            lead = float(row @ self.entry[:, 0])
            rounding = ROUNDING * float(np.linalg.norm(row) * np.linalg.norm(self.entry))
            if abs(lead) > max(CANCELLED * float(size @ np.abs(self.entry[:, 0])), rounding):
                return chain, lead
            row, size = row @ self.state, size @ np.abs(self.state)
        raise ZeroDivisionError("the operator is zero")

    @property
    def vanishes(self) -> bool:
        """Whether the operator gives zero whatever comes in."""
        if self.direct.any():
            return False
        columns = (Operator(self.state, self.entry[:, [i]], self.exit, self.direct[:, [i]]) for i in range(self.inputs))
        return all(column._is_cut_off() for column in columns)

    def _is_cut_off(self) -> bool:
        try:
            self._chain()
        except ZeroDivisionError:
            return True
        return False

    def minimal(self) -> "Operator":
        """The same transfer function without the states that no input reaches or no output shows.

        The smallest that answers as this one does, within ``SAME`` at frequencies around all poles, is returned.
        """
        whole = self._without_rounded_derivatives()
        # First none of them: what they show may be rounding, beside the polynomial.
        candidates = (_polynomial(whole.direct), *(whole._without(rank) for rank in RANKS))
        return next((each for each in candidates if each.order < whole.order and whole.answers_as(each)), whole)

    def _without_rounded_derivatives(self) -> "Operator":
        """Without highest derivatives that outweigh the rest at no speed of a mechanism: they are rounding."""
        direct = self.direct
        while direct.any():
            rest = np.vstack([direct[:-1], np.zeros_like(direct[:1])])
            slow = Operator(self.state, self.entry, self.exit, _trimmed(rest))
            weight = np.abs(direct[-1]) * FASTEST_RAD_S ** (len(direct) - 1)
            if not np.all(weight <= np.abs(slow.response(1j * FASTEST_RAD_S)[0])):
                break
            direct = slow.direct
        return Operator(self.state, self.entry, self.exit, direct)

    def _without(self, rank: float) -> "Operator":
        balanced, (scale, _) = matrix_balance(self.state, permute=False, separate=True) if self.order else _NOTHING
        entry, exit_row = self.entry / scale[:, None], self.exit * scale
        reached = _reached(np.asarray(balanced, dtype=float), entry, rank)
        size = float(np.linalg.norm(exit_row))
        state, entry, exit_row = _projected(np.asarray(balanced, dtype=float), entry, exit_row, reached)
        # What is left of the row by rounding alone shows nothing.
        shown = exit_row[:, None] if np.linalg.norm(exit_row) > rank * size else np.zeros((len(state), 0))
        return Operator(*_projected(state, entry, exit_row, _reached(state.T, shown, rank)), self.direct)

    def answers_as(self, other: "Operator", tolerance: float = SAME) -> bool:
        """Whether both have one transfer function, judged off the axis at frequencies around the poles of both."""
        speeds = np.abs(np.concatenate([self.poles(), other.poles()]))
        speeds = speeds[speeds > 0.0]
        low, high = (speeds.min(), speeds.max()) if speeds.size else (1.0, 1.0)
        points = np.geomspace(low / 30.0, high * 30.0, 25) * np.exp(1.1j)
        mine, its = self.response(points), other.response(points)
        return bool(np.all(np.abs(mine - its) <= tolerance * np.abs(mine).max(axis=1, keepdims=True, initial=0.0)))


def driven(state: FloatArray, entries: Sequence[FloatArray], exit_row: FloatArray) -> Operator:
    """y = C w of ẇ = A w + Σ Bi u⁽ⁱ⁾: derivatives of u move from the states into the polynomial."""
    # (s − A)⁻¹ sⁱ = Aⁱ (s − A)⁻¹ + Σ_{j<i} Aⁱ⁻¹⁻ʲ sʲ
    entry, size = entries[0], np.abs(entries[0])
    direct = np.zeros((max(len(entries) - 1, 1), entries[0].shape[1]))
    sizes = np.zeros_like(direct)
    for i, each in enumerate(entries[1:], start=1):
        moved, bound = each, np.abs(each)
        for j in range(i - 1, -1, -1):
            direct[j] += exit_row @ moved
            sizes[j] += np.abs(exit_row) @ bound
            moved, bound = state @ moved, np.abs(state) @ bound
        entry, size = entry + moved, size + bound
    return Operator(state, _cleared(entry, size), exit_row, _trimmed(_cleared(direct, sizes)))


def _polynomial(direct: FloatArray) -> Operator:
    return Operator(np.zeros((0, 0)), np.zeros((0, direct.shape[1])), np.zeros(0), direct)


def _projected(
    state: FloatArray, entry: FloatArray, exit_row: FloatArray, basis: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The system in the directions of ``basis``; what cancels there is zero, or an inverse would take it for a gain."""
    across, size = basis.T, np.abs(basis)
    return (
        across @ state @ basis,
        _cleared(across @ entry, size.T @ np.abs(entry)),
        _cleared(exit_row @ basis, np.abs(exit_row) @ size),
    )


def _reached(state: FloatArray, entry: FloatArray, rank: float) -> FloatArray:
    """An orthonormal basis (n, r) of the states that ``entry`` reaches, found a direction at a time."""
    basis = np.zeros((len(state), 0))
    waiting = [column / size for column in entry.T if (size := float(np.linalg.norm(column))) > 0.0]
    while waiting and basis.shape[1] < len(state):
        column = waiting.pop(0)
        size = float(np.linalg.norm(column))
        for _ in range(2):  # once more: what the first pass left of the basis in it
            column = column - basis @ (basis.T @ column)
        if (left := float(np.linalg.norm(column))) > rank * size:
            basis = np.column_stack([basis, column / left])
            waiting.append(state @ basis[:, -1])
    return basis


def _unit_rows(rows: FloatArray) -> FloatArray:
    return np.asarray(rows / np.linalg.norm(rows, axis=1, keepdims=True))


def _padded(direct: FloatArray, rows: int) -> FloatArray:
    return np.vstack([direct, np.zeros((rows - len(direct), direct.shape[1]))])


def _trimmed(direct: FloatArray) -> FloatArray:
    last = max((i for i, row in enumerate(direct) if row.any()), default=0)
    return direct[: last + 1]


def _cleared(value: FloatArray, size: FloatArray) -> FloatArray:
    """``value``, with zero where it is no more than the rounding of its terms, ``size``."""
    return np.where(np.abs(value) <= CANCELLED * size, 0.0, value)


def _larger(one: FloatArray, other: FloatArray) -> FloatArray:
    return one if len(one) else other


def stable(poles: npt.ArrayLike) -> bool:
    """Whether no pole grows. Integrators do not, and rounding leaves them a little beside zero."""
    result = np.asarray(poles, dtype=complex)
    speeds = np.abs(result)
    slow = speeds <= 1e-7 * speeds.max(initial=0.0)
    return bool(np.all(slow | (result.real <= 1e-6 * speeds)))
