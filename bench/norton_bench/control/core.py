"""The controller's arithmetic of one tick, compiled: running observer, Dahl contact, feed-forward and feedback.

Calling costs more than computing, so that a tick makes few calls: :func:`sense`, :func:`track` (or
:func:`feed_forward`), :func:`pass_on` and :func:`advance`. What they remember is kept in arrays:

- ``states`` (past + 1, width), newest first, at this and the last ticks; ``inputs`` (past + 1, 4), of which row i acts
  from the tick of ``states[i]`` on: command in force, next command, and what friction is known to do: the torque on the
  load [N m] and the actuator's free acceleration [rad/s²];
- ``contacts`` (2, 2), the load's and the actuator's: force of its friction contact [N m], and the load's position
  [rad] at which it was that;
- ``unread`` (1,), the ticks since the states were last corrected;
- ``clocks`` (3, 5), of each reading: last arrival without its jitter, period [s], readings behind both, strays, and
  periods by which the last of them was late;
- ``commands``, sent, and ``shares``, the part of each that was fed forward, newest first [N m];
- ``feed``: what the shares alone make the amplifier deliver now, and when the next command arrives [N m];
- ``path``: the contact's force along the reference [N m], and velocity and acceleration of its last instant.

And what they know: ``laws`` of friction (2, 4), the load's and the actuator's: B, τc, σ0, σ1, all zero where nothing
is known; ``law``, the load's alone; ``lag`` of the amplifier: its gain, the limit of a share [N m], and what stays of a
difference over a tick, over its part before a command arrives, and over that after.
"""

from math import ceil, exp, expm1

import numpy as np
from numba import njit

# The clock of a stream forgets readings older than about so many.
CLOCK_READINGS = 200.0
# After so many its period is known, and a reading half a period off is a stray. So many in a row are a new beginning,
# and so are two that are equally off by more than so many periods: nobody listened for a while.
SETTLED_READINGS, STRAYS, FAR_PERIODS = 20.0, 3.0, 10.0
# One that is off by whole periods, to this part of one, is none if the next one is, too: readings were lost.
WHOLE = 0.1
# Steps in which the free motion is foreseen over the load's delay: friction turns round within a third of it.
STEPS_AHEAD = 8


@njit(cache=True)
def slide(force, displacement, coulomb, stiffness):  # type: ignore[no-untyped-def]
    """The Dahl contact's exact flow over a displacement [rad]: its force σ0 φ [N m] afterwards."""
    if displacement == 0.0:
        return force
    end = coulomb if displacement > 0.0 else -coulomb
    return end + (force - end) * exp(-stiffness * abs(displacement) / coulomb)


@njit(cache=True)
def friction(force, velocity, law):  # type: ignore[no-untyped-def]
    """Friction torque [N m] at a velocity, given the contact's force; ``law`` is (B, τc, σ0, σ1)."""
    return force + law[3] * (velocity - abs(velocity) * force / law[1]) + law[0] * velocity


@njit(cache=True)
def friction_over(force, velocity, tick, law):  # type: ignore[no-untyped-def]
    """Its mean [N m] over a tick at a steady velocity, with the contact's force at the beginning.

    As the force changes by no more than twice τc, so it is bounded where the momentary one is not: a stiff and strongly
    damped contact that has just been turned round would otherwise push more in a tick than stops the shaft.
    """
    sliding = law[2] * abs(velocity) * tick / law[1]  # in lengths over which the contact builds up
    if sliding == 0.0:
        return force + law[0] * velocity
    end = law[1] if velocity > 0.0 else -law[1]
    gone = -expm1(-sliding)  # of the difference to where the contact's force ends
    contact = end + (force - end) * gone / sliding
    return contact + law[3] / law[2] * (end - force) * gone / tick + law[0] * velocity


@njit(cache=True)
def steady_arrival(clock, arrival, count):  # type: ignore[no-untyped-def]
    """Whether it is known when the last reading of a device that samples steadily was true; ``clock`` says when.

    ``count`` readings came, the last of them at ``arrival``. ``clock`` is when the last reading would have arrived
    without jitter, the period, how many readings both rest on, how many strays there were in a row, and by how many
    periods the last stray was late: a straight line through all readings at first, later one that forgets (expanding,
    then fading memory). What was held up on its way says nothing of the clock. One that is late by whole periods, or by
    many, was held up, or those before it were lost: the next one tells, for lost readings leave all later ones as late,
    and what was held up comes at once.
    """
    if clock[2] < 1.0:
        clock[0], clock[2] = arrival, 1.0
        return True
    expected = clock[0] + count * clock[1]
    late = arrival - expected
    if clock[2] > SETTLED_READINGS and abs(late) > 0.5 * clock[1]:
        periods = np.floor(late / clock[1] + 0.5)
        again = clock[3] > 0.0 and periods == clock[4]
        whole = abs(late - periods * clock[1]) < WHOLE * clock[1]
        far = abs(late) > FAR_PERIODS * clock[1]
        if not (again and whole):
            clock[0], clock[3], clock[4] = expected, clock[3] + 1.0, periods
            if (again and far) or clock[3] > (SETTLED_READINGS if far else STRAYS):
                clock[0], clock[2], clock[3] = arrival, SETTLED_READINGS + 1.0, 0.0
                return True
            return not (whole or far)
        expected += periods * clock[1]
        late = arrival - expected
    n = min(clock[2], CLOCK_READINGS)
    clock[0] = expected + 2.0 * (2.0 * n + 1.0) / ((n + 1.0) * (n + 2.0)) * late
    clock[1] += 6.0 / ((n + 1.0) * (n + 2.0)) * late / count
    clock[2] += 1.0
    clock[3] = 0.0
    return True


@njit(cache=True)
def correct(states, inputs, readings, delays, fresh, tick, rows, gain):  # type: ignore[no-untyped-def]
    """Correct the states by the readings that are fresh, of triples; ``delays`` [s] say when each was true."""
    past, width = states.shape[0] - 1, states.shape[1]
    innovation = np.zeros(3)
    for output in range(3):
        ticks = delays[output] / tick
        back = max(1, ceil(ticks - 1e-9))
        if fresh[output] and back <= past:
            # Between the instants for which there are rows, linearly: at speed, microseconds are counts.
            place = min(max((back - ticks) * (rows.shape[0] - 1), 0.0), rows.shape[0] - 1.0)
            first = min(int(place), rows.shape[0] - 2)
            share = place - first
            expected = 0.0
            for i in range(width + inputs.shape[1]):
                weight = (1.0 - share) * rows[first, output, i] + share * rows[first + 1, output, i]
                expected += weight * (states[back, i] if i < width else inputs[back, i - width])
            innovation[output] = readings[output] - expected
    for age in range(past + 1):
        for i in range(width):
            for output in range(3):
                states[age, i] += gain[age * width + i, output] * innovation[output]


@njit(cache=True)
def sense(  # type: ignore[no-untyped-def]
    states,
    inputs,
    contacts,
    clocks,
    readings,
    ages,
    delays,
    counts,
    now,
    tick,
    rows,
    gains,
    unread,
    laws,
    position,
):
    """Use one tick's readings, and let the contacts slide by what the shaft has turned (at row ``position``).

    ``ages`` and ``delays`` [s] of each reading: since it arrived, and until then. ``counts`` of each came since the
    last tick.
    """
    since, fresh = np.empty(3), np.empty(3, np.bool_)
    for output in range(3):
        fresh[output] = counts[output] > 0
        if fresh[output]:
            fresh[output] = steady_arrival(clocks[output], now - ages[output], counts[output])
        since[output] = delays[output] + now - clocks[output, 0]  # a late tick may see readings from after it
    if fresh[0] or fresh[1] or fresh[2]:
        gap = min(max(unread[0] - 1, 0), gains.shape[0] - 1)
        correct(states, inputs, readings, since, fresh, tick, rows, gains[gap])
        unread[0] = 0
    for side in range(2):
        if laws[side, 1] > 0.0:
            turned = states[0, position] - contacts[side, 1]
            contacts[side, 0] = slide(contacts[side, 0], turned, laws[side, 1], laws[side, 2])
            contacts[side, 1] = states[0, position]


@njit(cache=True)
def predict(states, inputs, step):  # type: ignore[no-untyped-def]
    """Move every state one tick on, under ``inputs[0]``."""
    width = states.shape[1]
    new = np.zeros(width)
    for i in range(width):
        for j in range(width):
            new[i] += step[i, j] * states[0, j]
        for j in range(inputs.shape[1]):
            new[i] += step[i, width + j] * inputs[0, j]
    for age in range(states.shape[0] - 1, 0, -1):
        states[age] = states[age - 1]
        inputs[age] = inputs[age - 1]
    states[0] = new


@njit(cache=True)
def put_first(values, newest):  # type: ignore[no-untyped-def]
    """Move ``values`` one place on, ``newest`` to the front."""
    for i in range(values.size - 1, 0, -1):
        values[i] = values[i - 1]
    values[0] = newest


@njit(cache=True)
def clipped(value, limit):  # type: ignore[no-untyped-def]
    """``value`` within ± ``limit``; what is no number stays none."""
    if value > limit:
        return limit
    return -limit if value < -limit else value


@njit(cache=True)
def along_reference(path, velocity, acceleration, law, inertia, between, tick):  # type: ignore[no-untyped-def]
    """The torque along the reference ``between`` (a share of a tick) beyond its last instant, now no longer the last.

    ``velocity`` and ``acceleration`` are those of the newest instant.
    """
    v = path[1] + between * (velocity - path[1])
    a = path[2] + between * (acceleration - path[2])
    path[0] = slide(path[0], v * tick, law[1], law[2])
    path[1], path[2] = velocity, acceleration
    return inertia * a + friction(path[0], v, law)


@njit(cache=True)
def begin_feed(shares, feed, lag, torque):  # type: ignore[no-untyped-def]
    """As if ``torque`` had been asked for all along."""
    shares[:] = clipped(torque / lag[0], lag[1])
    feed[:] = lag[0] * shares[0]


@njit(cache=True)
def ask(shares, feed, lag, torque):  # type: ignore[no-untyped-def]
    """Find this tick's share, so that ``torque`` is there when the next command arrives."""
    stays = lag[2]
    shares[0] = clipped((torque - stays * feed[1]) / ((1 - stays) * lag[0]), lag[1])
    feed[1] += (1 - stays) * (lag[0] * shares[0] - feed[1])


@njit(cache=True)
def pass_on(shares, feed, lag):  # type: ignore[no-untyped-def]
    """Let one tick pass over the feed-forward: the last two shares act in it, one after the other."""
    feed[0] += (1 - lag[3]) * (lag[0] * shares[-1] - feed[0])
    feed[0] += (1 - lag[4]) * (lag[0] * shares[-2] - feed[0])
    put_first(shares, shares[0])


@njit(cache=True)
def next_command(commands, shares, feed, lag, torque, begins):  # type: ignore[no-untyped-def]
    """The last command, changed as its feed-forward share changes, so that ``torque`` will be there."""
    if begins:
        begin_feed(shares, feed, lag, torque)
    ask(shares, feed, lag, torque)
    return commands[0] + shares[0] - shares[1]


@njit(cache=True)
def feed_forward(commands, shares, feed, lag, path, law, inertia, between, tick, velocity, acceleration, begins):  # type: ignore[no-untyped-def]
    """The last command, changed as what the reference needs changes."""
    torque = along_reference(path, velocity, acceleration, law, inertia, between, tick)
    return next_command(commands, shares, feed, lag, torque, begins)


@njit(cache=True)
def foreseen(velocity, free, rate, contacts, laws, inertias, lead):  # type: ignore[no-untyped-def]
    """The torque [N m] that takes the load along with the free actuator ``lead`` [s] from now.

    ``free`` is what the actuator's acceleration would be without its friction now [rad/s²], ``rate`` how it changes;
    ``inertias`` are the load's and the actuator's. Midpoint rule; the contacts slide by their exact flow.
    """
    step = lead / STEPS_AHEAD
    load, actuator = contacts[0, 0], contacts[1, 0]
    for i in range(STEPS_AHEAD):
        slope = free + rate * i * step - friction(actuator, velocity, laws[1]) / inertias[1]
        middle = velocity + 0.5 * step * slope
        halfway = slide(actuator, 0.5 * step * middle, laws[1, 1], laws[1, 2])
        slope = free + rate * (i + 0.5) * step - friction(halfway, middle, laws[1]) / inertias[1]
        actuator = slide(actuator, step * middle, laws[1, 1], laws[1, 2])
        load = slide(load, step * middle, laws[0, 1], laws[0, 2])
        velocity += step * slope
    acceleration = free + rate * lead - friction(actuator, velocity, laws[1]) / inertias[1]
    return inertias[0] * acceleration + friction(load, velocity, laws[0])


@njit(cache=True)
def anticipate(commands, shares, feed, lag, states, contacts, laws, inertias, places, lead, begins):  # type: ignore[no-untyped-def]
    """The last command, changed as what the free motion is foreseen to need changes.

    ``places`` says where velocity, free acceleration and its rate stand in a state.
    """
    now = states[0]
    torque = foreseen(now[places[0]], now[places[1]], now[places[2]], contacts, laws, inertias, lead)
    return next_command(commands, shares, feed, lag, torque, begins)


@njit(cache=True)
def feedback(states, contact, commands, shares, feed, law, inertia, on_state, on_commands, places, x, v, a):  # type: ignore[no-untyped-def]
    """Gains times deviations from the reference, those of the commands from their feed-forward shares included.

    ``x``, ``v`` and ``a`` are the reference's; ``places`` says where position, velocity, amplifier, free acceleration
    and load disturbance stand in a state.
    """
    total = 0.0
    for i in range(on_state.size):
        deviation = states[0, i]
        if i == places[0]:
            deviation -= x
        elif i == places[1]:
            deviation -= v
        elif i == places[2]:
            deviation -= feed[0]
        elif i == places[3]:
            deviation -= a
        elif i == places[4]:
            deviation = deviation + feed[0] - friction(contact[0], states[0, places[1]], law) - inertia * a
        total += on_state[i] * deviation
    for i in range(on_commands.size):
        total += on_commands[i] * (commands[i] - shares[i + 1])
    return total


@njit(cache=True)
def track(  # type: ignore[no-untyped-def]
    states,
    contact,
    commands,
    shares,
    feed,
    lag,
    path,
    law,
    on_state,
    on_commands,
    places,
    inertia,
    between,
    tick,
    x,
    v,
    a,
    ahead_v,
    ahead_a,
    begins,
):
    """The command that follows the reference: what is fed forward, less what the deviations ask for."""
    fed = feed_forward(commands, shares, feed, lag, path, law, inertia, between, tick, ahead_v, ahead_a, begins)
    return fed - feedback(states, contact, commands, shares, feed, law, inertia, on_state, on_commands, places, x, v, a)


@njit(cache=True)
def advance(states, inputs, contacts, commands, command, unread, laws, mobility, step, velocity, tick):  # type: ignore[no-untyped-def]
    """Let one tick pass with ``command`` sent; the last two of ``commands`` are those that act in it.

    ``mobility`` is one over the actuator's inertia where its friction counts as known, else 0.
    """
    unread[0] += 1
    put_first(commands, command)
    inputs[0, 0], inputs[0, 1] = commands[-1], commands[-2]
    inputs[0, 2] = -friction_over(contacts[0, 0], states[0, velocity], tick, laws[0])
    inputs[0, 3] = 0.0
    if mobility > 0.0:
        inputs[0, 3] = -mobility * friction_over(contacts[1, 0], states[0, velocity], tick, laws[1])
    predict(states, inputs, step)
