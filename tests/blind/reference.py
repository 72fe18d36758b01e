"""The reference integrator: smooth phases by SciPy, switched where events say so.

Between two switches every body with dry friction either sticks or slips in a known direction and
the play is either closed or open, so that the equations are smooth. An event ends the phase:
a slipping body comes to rest, friction can no longer hold a resting one, or a contact closes or
lets go. It is slow, and there to measure the fine-step integrator against.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from cjt_gym.blind.laws import (
    bar_torque,
    beyond,
    bristle_level,
    friction_levels,
    half_play,
    mount_torque,
    outer_torque,
    slip_share,
    warming_rate,
    wen_rate,
)
from cjt_gym.blind.plant import GEAR, LOAD, MOTOR, MOUNT, Floats, World, packed
from cjt_gym.blind.run import frame_of
from cjt_gym.blind.state import (
    BRISTLE,
    CREEP,
    CURRENT,
    HEAT,
    SIZE,
    SLEWED,
    SLIP,
    SLIPS,
    WARM,
    WEN,
    Q,
    V,
    initial_state,
)
from cjt_gym.blind.stepper import reference_current

STICK = 0
REST = 1e-9
"""Speed below which a body at the start of a phase may stick [rad/s]."""
RTOL, ATOL = 1e-9, 1e-12


@dataclass
class Phase:
    """What does not change until the next event.

    Attributes:
        modes: For each leading body with dry friction +1 or -1 (slips that way) or 0 (sticks).
        closed: Whether the play is in contact.
    """

    modes: dict[int, int] = field(default_factory=dict)
    closed: bool = True


def _watched(event: Any, direction: float) -> Any:
    """Return the event, made to end a phase where it changes sign in that direction."""
    event.direction, event.terminal = direction, True
    return event


class Reference:
    """A joint under a constant command, integrated from event to event.

    The slew limit of the drive is not part of it.
    """

    def __init__(self, world: World, command: float) -> None:
        self.world, self.frame = world, frame_of(world)
        self.plant, self.p = world.plant, packed(world.plant)
        self.target = float(reference_current(packed(world.drive), command))
        s, mass = self.frame.s, self.frame.mass
        self.mobility: Floats = s @ np.linalg.inv(s.T @ mass @ s) @ s.T
        self.leads = world.structure.leads
        self.switches = 0

    # ------------------------------------------------------------------ torques

    def half(self, x: Floats) -> float:
        """Return half of the play [rad]."""
        return float(half_play(self.p, x[Q]))

    def contact(self, x: Floats) -> tuple[float, float]:
        """Return how far the twist is beyond the play [rad], and the torque of contact there."""
        p, soft = self.plant, self.world.structure.gear_is_soft
        one, other = (MOTOR, GEAR) if soft else (GEAR, LOAD)
        twist = float(beyond(x[Q + one] - x[Q + other], self.half(x)))
        rate = x[V + one] - x[V + other]
        elastic = p.k_g * twist if soft else bar_torque(self.p, x, twist)
        return twist, float(elastic + (p.d_mg if soft else p.d_gl) * rate)

    def bar(self, x: Floats, closed: bool) -> float:
        """Return the torque of the torsion bar [N m]."""
        if not self.world.structure.gear_is_soft:
            return self.contact(x)[1] if closed else 0.0
        twist = x[Q + GEAR] - x[Q + LOAD]
        rate = x[V + GEAR] - x[V + LOAD]
        return float(bar_torque(self.p, x, twist) + self.plant.d_gl * rate)

    def driving(self, t: float, x: Floats, closed: bool) -> tuple[Floats, float]:
        """Return the torques on the bodies without dry friction, shape (4,), and the bar's."""
        p, structure = self.p, self.world.structure
        tau = self.bar(x, closed) if structure.bar_is_soft else 0.0
        force = np.zeros(4)
        for body in range(3):
            force[body] = outer_torque(p, x, body, t, tau)
        if structure.bar_is_soft:
            force[GEAR] -= tau
            force[LOAD] += tau
        if structure.gear_is_soft and closed:
            mesh = self.contact(x)[1]
            force[MOTOR] -= mesh
            force[GEAR] += mesh
        pull = mount_torque(p, x, self.frame.attach)
        force[self.frame.attach] += pull
        force[MOUNT] -= pull
        return force, tau

    def levels(self, x: Floats, lead: int, tau: float) -> tuple[float, float]:
        """Return the friction levels of all bodies that move with `lead` [N m]."""
        pairs = [
            friction_levels(self.p, body, x[V + body], tau, x[Q], x[WARM])
            for body in range(3)
            if self.leads[body] == lead
        ]
        return sum(pair[0] for pair in pairs), sum(pair[1] for pair in pairs)

    # ------------------------------------------------------------------ motion in a phase

    def friction(self, t: float, x: Floats, phase: Phase) -> tuple[Floats, dict[int, float]]:
        """Return the accelerations, shape (4,), and the torque that each sticking body needs."""
        force, tau = self.driving(t, x, phase.closed)
        for lead, mode in phase.modes.items():
            if mode != STICK:
                up, down = self.levels(x, lead, tau)
                force[lead] -= up if mode > 0 else -down
        stuck = [lead for lead, mode in phase.modes.items() if mode == STICK]
        free = self.mobility @ force
        if not stuck:
            return free, {}
        block = self.mobility[np.ix_(stuck, stuck)]
        needed = np.linalg.solve(block, free[stuck])
        return free - self.mobility[:, stuck] @ needed, dict(zip(stuck, needed, strict=True))

    def rate(self, t: float, x: Floats, phase: Phase) -> Floats:
        """Return the time derivative of the state, shape (SIZE,)."""
        p, out = self.plant, np.zeros(SIZE)
        out[Q : Q + 4] = x[V : V + 4]
        out[V : V + 4], _ = self.friction(t, x, phase)
        out[CURRENT] = 2.0 * np.pi * self.world.drive.bandwidth * (self.target - x[CURRENT])
        out[HEAT] = (x[CURRENT] ** 2 - x[HEAT]) / p.heat_time
        out[WARM] = warming_rate(self.p, x[V])
        for body in range(3):
            if bristle_level(self.p, body) > 0.0:
                v = x[V + body]
                out[BRISTLE + body] = v - abs(v) * x[BRISTLE + body] / p.z_s
        self.bar_rates(x, phase, out)
        return out

    def bar_rates(self, x: Floats, phase: Phase, out: Floats) -> None:
        """Write the rates of what the bar remembers, in place."""
        p = self.plant
        twist, rate = x[Q + GEAR] - x[Q + LOAD], x[V + GEAR] - x[V + LOAD]
        if not self.world.structure.gear_is_soft:
            twist = beyond(twist, self.half(x))
            rate = rate if twist != 0.0 or self.half(x) == 0.0 else 0.0
        out[CREEP] = (p.creep * twist - x[CREEP]) / p.creep_time
        out[WEN] = rate * wen_rate(x[WEN], p.wen_width, np.sign(rate))
        for e in range(SLIPS):
            z, limit = x[SLIP + e], slip_share(e)[1] * p.slip_width
            out[SLIP + e] = 0.0 if abs(z) >= limit and z * rate > 0.0 else rate

    # ------------------------------------------------------------------ switching

    def rubbing(self, x: Floats, tau: float) -> list[int]:
        """Return the leading bodies on which dry friction acts."""
        leads = sorted({lead for lead in self.leads[:3] if lead >= 0})
        return [lead for lead in leads if sum(self.levels(x, lead, tau)) > 0.0]

    def settle(self, t: float, x: Floats, phase: Phase) -> None:
        """Let resting bodies slip where friction cannot hold them; modes change in place."""
        for _ in range(4):
            _, needed = self.friction(t, x, phase)
            tau = self.driving(t, x, phase.closed)[1]
            excess = {}
            for lead, torque in needed.items():
                up, down = self.levels(x, lead, tau)
                if torque > up or torque < -down:
                    excess[lead] = torque
            if not excess:
                return
            worst = max(excess, key=lambda lead: abs(excess[lead]))
            phase.modes[worst] = 1 if excess[worst] > 0.0 else -1

    def start(self, t: float, x: Floats) -> Phase:
        """Return the phase that a state begins with."""
        twist, torque = self.contact(x)
        closed = self.half(x) <= 0.0 or twist * torque > 0.0
        tau = self.driving(t, x, closed)[1]
        phase = Phase({}, closed)
        for lead in self.rubbing(x, tau):
            v = x[V + lead]
            phase.modes[lead] = STICK if abs(v) < REST else int(np.sign(v))
        self.settle(t, x, phase)
        return phase

    def events(self, phase: Phase) -> list[tuple[Any, str, int]]:
        """Return the events that may end a phase: function of (t, x), kind, body."""
        found: list[tuple[Any, str, int]] = []
        for lead, mode in phase.modes.items():
            if mode != STICK:
                found.append((self._slip_event(lead, mode), "rest", lead))
            else:
                found += [
                    (self._stick_event(lead, way, phase), kind, lead)
                    for way, kind in ((1, "forward"), (-1, "backward"))
                ]
        if self.world.plant.play + self.world.plant.loose > 0.0:
            found += [
                (self._edge_event(1, phase.closed), "contact", 0),
                (self._edge_event(-1, phase.closed), "contact", 0),
                (self._torque_event(phase.closed), "contact", 0),
            ]
        return found

    def _slip_event(self, lead: int, mode: int) -> Any:
        def event(_t: float, x: Floats) -> float:
            return float(x[V + lead] * mode)

        return _watched(event, -1.0)

    def _stick_event(self, lead: int, way: int, phase: Phase) -> Any:
        def event(t: float, x: Floats) -> float:
            _, needed = self.friction(t, x, phase)
            up, down = self.levels(x, lead, self.driving(t, x, phase.closed)[1])
            return up - needed[lead] if way > 0 else down + needed[lead]

        return _watched(event, -1.0)

    def _edge_event(self, side: int, closed: bool) -> Any:
        """Return the event that one side of the play is reached, or left."""
        soft = self.world.structure.gear_is_soft
        one, other = (MOTOR, GEAR) if soft else (GEAR, LOAD)

        def event(_t: float, x: Floats) -> float:
            return float(side * (x[Q + one] - x[Q + other]) - self.half(x))

        return _watched(event, -1.0 if closed else 1.0)

    def _torque_event(self, closed: bool) -> Any:
        """Return the event that a contact lets go, or pushes again before it was left."""

        def event(_t: float, x: Floats) -> float:
            twist, torque = self.contact(x)
            if twist == 0.0:
                return 1.0 if closed else -1.0
            return float(torque * np.sign(twist))

        return _watched(event, -1.0 if closed else 1.0)

    def switch(self, t: float, x: Floats, phase: Phase, kind: str, lead: int) -> None:
        """Change the phase for an event, in place."""
        self.switches += 1
        if kind == "rest":
            phase.modes[lead] = STICK
            for body in range(4):
                if self.leads[body] == lead:
                    x[V + body] = 0.0
            self.settle(t, x, phase)
        elif kind in ("forward", "backward"):
            phase.modes[lead] = 1 if kind == "forward" else -1
        else:
            phase.closed = not phase.closed

    # ------------------------------------------------------------------ integration

    def integrate(self, x: Floats, t: float, end: float) -> Floats:
        """Return the state at `end` [s], from the state at `t`, shape (SIZE,)."""
        x = x.copy()
        phase = self.start(t, x)
        while t < end:
            watched = self.events(phase)
            part = solve_ivp(
                lambda now, y, phase=phase: self.rate(now, y, phase),
                (t, end),
                x,
                method="DOP853",
                rtol=RTOL,
                atol=ATOL,
                max_step=2e-4,
                events=[event for event, _, _ in watched] or None,
            )
            t, x = float(part.t[-1]), part.y[:, -1].copy()
            if part.status != 1:
                return x
            hit = next(j for j, times in enumerate(part.t_events) if len(times))
            self.switch(t, x, phase, *watched[hit][1:])
        return x


def reference_states(world: World, command: Floats) -> Floats:
    """Return the states at every sample under commands held between them, shape (n, SIZE).

    The command takes effect at its sample; delay and slew limit of the drive are left out.
    """
    x = initial_state(world)
    states = np.zeros((len(command), SIZE))
    for k in range(len(command) - 1):
        states[k] = x
        joint = Reference(world, float(command[k]))
        x = joint.integrate(x, k * world.sampling, (k + 1) * world.sampling)
        x[SLEWED] = joint.target
    states[-1] = x
    return states
