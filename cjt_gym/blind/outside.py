"""Effects outside the effect table, for which a diagnosis should say "unexplained"."""

from __future__ import annotations

import math
from dataclasses import replace

from cjt_gym.blind.hidden import (
    Draw,
    Outcome,
    Places,
    on_drive,
    on_plant,
    on_sensing,
    row,
    table,
    with_spring,
)
from cjt_gym.blind.plant import Structure, World


def _ends(structure: Structure) -> Places:
    own = structure.bar_is_soft and not structure.is_locked
    return ("motor", "load") if own else ("motor",)


def _encoders(structure: Structure) -> Places:
    return ("q_m",) if structure.is_locked else ("q_m", "q_l")


def _over_travel(draw: Draw) -> float:
    """Return a frequency over q_m with one to four periods within the travel [1/rev]."""
    return draw.rng.uniform(1.0, 4.0) * 2.0 * math.pi / max(draw.scales.travel, 1e-6)


@row("quadratic_friction", "motor", _ends, drag="N m s^2/rad^2")
def quadratic_friction(world: World, draw: Draw) -> Outcome:
    """Return a drag c v |v|."""
    speed = max(draw.scales.speed[draw.body], 1e-6)
    drag = draw.size(0.08, 0.3) * draw.torque / speed**2
    return on_plant(world, **{f"drag_{draw.suffix}": drag}), {"drag": drag}


@row("encoder_eccentricity", "sensing", _encoders, size="rad", f="1/rev")
def encoder_eccentricity(world: World, draw: Draw) -> Outcome:
    """Return an encoder with a sinusoidal error once or twice per revolution."""
    spring = draw.scales.twist if world.structure.bar_is_soft else 0.0
    size = draw.size(0.1, 0.5) * max(spring, 100.0 * world.resolution[1])
    phase = draw.rng.uniform(0.0, 2.0 * math.pi)
    if draw.place == "q_l":
        return on_sensing(world, ecc_l=20.0 * size, ecc_phase=phase), {
            "size": 20.0 * size,
            "f": 1.0,
        }
    f = world.plant.n * float(draw.rng.integers(1, 3))
    return on_sensing(world, ecc_m=size, ecc_m_f=f, ecc_phase=phase), {"size": size, "f": f}


@row("current_dead_zone", "drive", dead="A")
def current_dead_zone(world: World, draw: Draw) -> Outcome:
    """Return a drive that does not respond to small commands."""
    dead = draw.size(0.06, 0.3) * draw.scales.current
    return on_drive(world, dead=dead), {"dead": dead}


@row("vibration", "motor", _ends, torque="N m", f="Hz")
def vibration(world: World, draw: Draw) -> Outcome:
    """Return an external periodic torque."""
    size, f = draw.size(0.08, 0.3) * draw.torque, draw.plain(3.0, 45.0)
    changed = on_plant(
        world,
        **{f"shake_{draw.suffix}": size},
        shake_f=2.0 * math.pi * f,
        shake_phase=draw.rng.uniform(0.0, 2.0 * math.pi),
    )
    return changed, {"torque": size, "f": f}


@row("current_slew", "drive", slew="A/s")
def current_slew(world: World, draw: Draw) -> Outcome:
    """Return a current with a limited slew rate."""
    share = draw.size(1.0, 4.0)
    slew = draw.scales.peak * 200.0 / share if share > 0.0 else math.inf
    return on_drive(world, slew=slew), {"slew": slew}


@row("creep", "transmission", with_spring, share="-", time="s")
def creep(world: World, draw: Draw) -> Outcome:
    """Return a bar that creeps by a share of its twist over time."""
    share, time = draw.size(0.1, 0.4), draw.plain(0.05, 1.5)
    return on_plant(world, creep=share, creep_time=time), {"share": share, "time": time}


@row("warm_up", "motor", level="N m", time="s", travel="rad")
def warm_up(world: World, draw: Draw) -> Outcome:
    """Return dry friction of the motor that fades with time and travel."""
    level, time = draw.size(0.12, 0.4) * draw.scales.motor_torque, draw.plain(3.0, 10.0)
    travel = draw.plain(3.0, 10.0) * max(draw.scales.path, 1e-6)
    changed = on_plant(world, cold=level, cold_time=time, cold_travel=travel)
    return changed, {"level": level, "time": time, "travel": travel}


@row("position_friction", "motor", level="N m", f="1/rev")
def position_friction(world: World, draw: Draw) -> Outcome:
    """Return dry friction of the motor that varies with its angle."""
    level, f = draw.size(0.12, 0.4) * draw.scales.motor_torque, _over_travel(draw)
    phase = draw.rng.uniform(0.0, 2.0 * math.pi)
    return on_plant(world, spot=level, spot_f=f, spot_phase=phase), {"level": level, "f": f}


@row("flexible_mount", "transmission", I_f="kg m^2", f="Hz", d_f="N m s/rad")
def flexible_mount(world: World, draw: Draw) -> Outcome:
    """Return a mass on a spring, on the gear of a locked joint or the load of a free one."""
    p = world.plant
    inertia = draw.size(0.1, 0.4) * (p.I_m + p.I_g if world.structure.is_locked else p.I_l)
    f = draw.plain(6.0, 40.0)
    if inertia == 0.0:
        return world, {"I_f": 0.0, "f": f, "d_f": 0.0}
    stiffness = inertia * (2.0 * math.pi * f) ** 2
    d_f = 2.0 * draw.plain(0.02, 0.08) * math.sqrt(stiffness * inertia)
    return on_plant(world, I_f=inertia, k_f=stiffness, d_f=d_f), {
        "I_f": inertia,
        "f": f,
        "d_f": d_f,
    }


@row("asymmetric_stiffness", "transmission", with_spring, skew="-")
def asymmetric_stiffness(world: World, draw: Draw) -> Outcome:
    """Return a bar that is stiffer in one direction, k_b (1 +- skew)."""
    skew = draw.sign() * draw.size(0.06, 0.25)
    return on_plant(world, skew=skew), {"skew": skew}


@row("crosstalk", "sensing", gain="N m/A")
def crosstalk(world: World, draw: Draw) -> Outcome:
    """Return a torque sensor that also reads the current."""
    gain = draw.sign() * draw.size(0.04, 0.2) * draw.scales.joint_torque / draw.scales.current
    return on_sensing(world, crosstalk=gain), {"gain": gain}


@row("mains_hum", "sensing", current="A", f="Hz")
def mains_hum(world: World, draw: Draw) -> Outcome:
    """Return a current sensor that picks up the mains."""
    size = draw.size(0.05, 0.25) * draw.scales.current
    f = float(draw.rng.choice([50.0, 60.0]))
    phase = draw.rng.uniform(0.0, 2.0 * math.pi)
    return on_sensing(world, hum=size, hum_f=f, hum_phase=phase), {"current": size, "f": f}


@row("missing_counts", "sensing", counts="rad", rate="1/s")
def missing_counts(world: World, draw: Draw) -> Outcome:
    """Return a motor encoder that occasionally loses counts, which shifts its zero."""
    least = world.resolution[1]
    scale = draw.scales.twist if world.structure.bar_is_soft else 100.0 * least
    counts = least * round(max(draw.size(0.02, 0.1) * scale / least, draw.strength))
    rate = draw.plain(1.5, 6.0) if counts > 0.0 else 0.0
    return replace(on_sensing(world, counts=counts), lost=rate), {"counts": counts, "rate": rate}


@row("torque_drift", "sensing", torque="N m", time="s")
def torque_drift(world: World, draw: Draw) -> Outcome:
    """Return a torque sensor whose zero drifts as it warms."""
    size, time = draw.size(0.15, 0.5) * draw.scales.joint_torque, draw.plain(2.0, 8.0)
    size *= draw.sign()
    return on_sensing(world, drift=size, drift_time=time), {"torque": size, "time": time}


@row("loose_coupling", "transmission", with_spring, play="rad", f="1/rev")
def loose_coupling(world: World, draw: Draw) -> Outcome:
    """Return a play that varies with the motor's angle."""
    play, f = draw.size(0.2, 1.0) * draw.scales.twist, _over_travel(draw)
    phase = draw.rng.uniform(0.0, 2.0 * math.pi)
    return on_plant(world, loose=play, loose_f=f, loose_phase=phase), {"play": play, "f": f}


OUTSIDE = table(dict(globals()))
"""The rows, by name."""
