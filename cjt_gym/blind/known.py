"""The thirty effects of the effect table, as this simulator implements them.

Parameters have the symbols and units of the effect table where it defines them. A changed parameter
of the joint is given by its true value. Friction rows name their body by the suffix m, g or l.
"""

from __future__ import annotations

import math
from dataclasses import replace

from cjt_gym.blind.hidden import (
    Draw,
    Outcome,
    Places,
    bodies,
    drive_side,
    on_drive,
    on_plant,
    on_sensing,
    periods,
    row,
    table,
    with_load,
    with_spring,
)
from cjt_gym.blind.plant import CHANNELS, Structure, World
from cjt_gym.blind.state import SLIPS

# ------------------------------------------------------------------ drive


@row("command_delay", "drive", delay="s")
def command_delay(world: World, draw: Draw) -> Outcome:
    """Return a dead time before the current loop."""
    delay = draw.size(2e-3, 12e-3)
    return on_drive(world, delay=delay), {"delay": delay}


@row("current_lag", "drive", bandwidth="Hz")
def current_lag(world: World, draw: Draw) -> Outcome:
    """Return a current loop that is slower than stated."""
    lag = 1.0 / (2.0 * math.pi * world.drive.bandwidth) + draw.size(1e-3, 1e-2)
    bandwidth = 1.0 / (2.0 * math.pi * lag)
    return on_drive(world, bandwidth=bandwidth), {"bandwidth": bandwidth}


@row("current_saturation", "drive", i_p="A")
def current_saturation(world: World, draw: Draw) -> Outcome:
    """Return a limit below the largest command."""
    i_max = draw.scales.peak * (1.0 - draw.size(0.2, 0.6))
    return on_drive(world, i_max=min(i_max, world.drive.i_max)), {"i_p": i_max}


@row("command_quantization", "drive", resolution="A")
def command_quantization(world: World, draw: Draw) -> Outcome:
    """Return a quantized command."""
    step = draw.size(0.1, 0.5) * draw.scales.current
    return on_drive(world, resolution=step), {"resolution": step}


# ------------------------------------------------------------------ motor


@row("torque_constant", "motor", k_t="N m/A")
def torque_constant(world: World, draw: Draw) -> Outcome:
    """Return a different torque constant."""
    k_t = world.plant.k_t * draw.ratio(0.1, 0.35)
    return on_plant(world, k_t=k_t), {"k_t": k_t}


@row("thermal_derating", "motor", loss="1/A^2", time_constant="s")
def thermal_derating(world: World, draw: Draw) -> Outcome:
    """Return a torque constant that falls by loss * (squared current, low-passed)."""
    time = draw.plain(2.0, 8.0)
    loss = draw.size(0.12, 0.4) / draw.scales.current**2
    return on_plant(world, heat_loss=loss, heat_time=time), {"loss": loss, "time_constant": time}


@row("torque_offset", "motor", torque="N m")
def torque_offset(world: World, draw: Draw) -> Outcome:
    """Return a constant torque on the motor."""
    torque = draw.sign() * draw.size(0.05, 0.25) * draw.scales.motor_torque
    return on_plant(world, torque_offset=torque), {"torque": torque}


@row("inertia", "motor", I_m="kg m^2")
def inertia(world: World, draw: Draw) -> Outcome:
    """Return a different inertia of the rotor, or of rotor and gear if they move together."""
    joined = world.plant.I_g if "gear" not in drive_side(world.structure) else 0.0
    value = (world.plant.I_m + joined) * draw.ratio(0.15, 0.4) - joined
    value = max(value, 0.2 * world.plant.I_m)
    return on_plant(world, I_m=value), {"I_m": value}


@row("damping", "motor", drive_side, d_m="N m s/rad", d_g="N m s/rad")
def damping(world: World, draw: Draw) -> Outcome:
    """Return more viscous damping."""
    name = f"d_{draw.suffix}"
    value = getattr(world.plant, name) + _viscous(draw)
    return on_plant(world, **{name: value}), {name: value}


def _viscous(draw: Draw) -> float:
    """Return a damping that consumes a share of the torque at the usual speed [N m s/rad]."""
    return draw.size(0.05, 0.25) * draw.torque / max(draw.scales.speed[draw.body], 1e-6)


def _dry(draw: Draw) -> float:
    """Return a level of dry friction [N m]."""
    return draw.size(0.05, 0.25) * draw.torque


@row("coulomb", "motor", drive_side, d_cm="N m", d_cg="N m")
def coulomb(world: World, draw: Draw) -> Outcome:
    """Return set-valued Coulomb friction; that of the load is a row of its own."""
    level, b = _dry(draw), draw.suffix
    return on_plant(world, **{f"up_{b}": level, f"down_{b}": level}), {f"d_c{b}": level}


@row(
    "coulomb_asym",
    "motor",
    bodies,
    **{f"d_c{b}{way}": "N m" for b in "mgl" for way in ("", "_n")},
)
def coulomb_asym(world: World, draw: Draw) -> Outcome:
    """Return Coulomb friction that differs between the two directions."""
    level, b = _dry(draw), draw.suffix
    skew = draw.sign() * draw.rng.uniform(0.2, 0.5)
    up, down = level * (1.0 + skew), level * (1.0 - skew)
    changed = on_plant(world, **{f"up_{b}": up, f"down_{b}": down})
    return changed, {f"d_c{b}": up, f"d_c{b}_n": down}


@row(
    "viscous_asym",
    "motor",
    bodies,
    **{f"d_{b}{way}": "N m s/rad" for b in "mgl" for way in ("", "_n")},
)
def viscous_asym(world: World, draw: Draw) -> Outcome:
    """Return more damping at negative velocity."""
    extra, b = 2.0 * _viscous(draw), draw.suffix
    own = getattr(world.plant, f"d_{b}")
    return on_plant(world, **{f"extra_{b}": extra}), {f"d_{b}": own, f"d_{b}_n": own + extra}


@row(
    "stribeck",
    "motor",
    bodies,
    v_s="rad/s",
    **{f"d_{kind}{b}": "N m" for kind in "cs" for b in "mgl"},
)
def stribeck(world: World, draw: Draw) -> Outcome:
    """Return friction d_c + d_s exp(-(v / v_s)^2), set-valued at rest."""
    level, b = _dry(draw), draw.suffix
    rise = level * draw.rng.uniform(0.4, 1.2)
    v_s = draw.plain(0.03, 0.3) * max(draw.scales.speed[draw.body], 1e-4)
    changed = on_plant(world, **{f"up_{b}": level, f"down_{b}": level, f"rise_{b}": rise}, v_s=v_s)
    return changed, {f"d_c{b}": level, f"d_s{b}": rise, "v_s": v_s}


@row(
    "presliding",
    "motor",
    bodies,
    **{f"d_c{b}": "N m" for b in "mgl"},
    **{f"sigma_{b}": "N m/rad" for b in "mgl"},
)
def presliding(world: World, draw: Draw) -> Outcome:
    """Return Dahl friction of level d_c and bristle stiffness sigma at rest."""
    level, b = _dry(draw), draw.suffix
    z_s = draw.plain(0.02, 0.2) * min(draw.scales.travel, 0.05)
    return on_plant(world, **{f"bristle_{b}": level}, z_s=z_s), {
        f"d_c{b}": level,
        f"sigma_{b}": level / z_s,
    }


@row("load_friction", "motor", drive_side, mu_m="-", mu_g="-")
def load_friction(world: World, draw: Draw) -> Outcome:
    """Return friction of mu times the transmitted torque."""
    mu = draw.size(0.04, 0.2)
    return on_plant(world, **{f"mu_{draw.suffix}": mu}), {f"mu_{draw.suffix}": mu}


@row("cogging", "motor", f="1/rev", a="N m", b="N m")
def cogging(world: World, draw: Draw) -> Outcome:
    """Return a torque a cos(f q_m) + b sin(f q_m) over the measured angle."""
    size, f = draw.size(0.08, 0.3) * draw.scales.motor_torque, periods(draw, world)
    own, seen = _phases(world, draw, size, f)
    return on_plant(world, cog_a=own[0], cog_b=own[1], cog_f=f), {"f": f, **seen}


@row("gear_ripple", "motor", f="1/rev", a="-", b="-")
def gear_ripple(world: World, draw: Draw) -> Outcome:
    """Return a torque periodic in the measured angle and proportional to the transmitted torque."""
    size, f = draw.size(0.05, 0.2), periods(draw, world)
    own, seen = _phases(world, draw, size, f)
    return on_plant(world, mesh_a=own[0], mesh_b=own[1], mesh_f=f), {"f": f, **seen}


def _phases(
    world: World, draw: Draw, size: float, f: float
) -> tuple[tuple[float, float], dict[str, float]]:
    """Return the amplitudes of cos and sin over the true and over the measured angle."""
    phase = draw.rng.uniform(0.0, 2.0 * math.pi)
    seen = phase + f * world.sensing.zero_m
    own = size * math.cos(phase), size * math.sin(phase)
    return own, {"a": size * math.cos(seen), "b": size * math.sin(seen)}


# ------------------------------------------------------------------ transmission


@row("backlash", "transmission", with_spring, gap="rad")
def backlash(world: World, draw: Draw) -> Outcome:
    """Return a total play of the gear, in series with the softest spring."""
    play = draw.size(0.1, 0.8) * draw.scales.twist
    return on_plant(world, play=play), {"gap": play}


@row("stiffness", "transmission", with_spring, k_b="N m/rad")
def stiffness(world: World, draw: Draw) -> Outcome:
    """Return a different stiffness of the torsion bar."""
    k_b = world.plant.k_b * draw.ratio(0.1, 0.4)
    return on_plant(world, k_b=k_b), {"k_b": k_b}


def _with_soft_gear(structure: Structure) -> Places:
    return ("",) if structure.gear_is_soft else ()


@row("gear_stiffness", "transmission", _with_soft_gear, k_g="N m/rad")
def gear_stiffness(world: World, draw: Draw) -> Outcome:
    """Return a different stiffness of the gearbox."""
    k_g = world.plant.k_g * draw.ratio(0.3, 0.7)
    return on_plant(world, k_g=k_g), {"k_g": k_g}


@row("hardening", "transmission", with_spring, k_3="N m/rad^3")
def hardening(world: World, draw: Draw) -> Outcome:
    """Return a bar with torque k_b twist + k_3 twist^3."""
    k_3 = draw.size(0.15, 0.8) * world.plant.k_b / draw.scales.bend**2
    return on_plant(world, k_3=k_3), {"k_3": k_3}


@row("spring_hysteresis", "transmission", with_spring, tau_h="N m", width="rad", elements="-")
def spring_hysteresis(world: World, draw: Draw) -> Outcome:
    """Return a bar with hysteresis: slip elements, or none for Bouc-Wen.

    `tau_h` is its largest torque, `width` the twist over which it builds up.
    """
    torque = draw.size(0.04, 0.15) * draw.scales.joint_torque
    width = draw.plain(0.15, 0.6) * draw.scales.joint_torque / world.plant.k_b
    slip = draw.rng.random() < 0.5
    kind = "slip" if slip else "wen"
    changed = on_plant(world, **{f"{kind}_torque": torque, f"{kind}_width": width})
    return changed, {"tau_h": torque, "width": width, "elements": float(SLIPS if slip else 0)}


# ------------------------------------------------------------------ sensing


@row("torque_gain", "sensing", gain="-")
def torque_gain(world: World, draw: Draw) -> Outcome:
    """Return a different scale of the torque sensor."""
    gain = draw.ratio(0.06, 0.25)
    return on_sensing(world, gain=gain), {"gain": gain}


@row("torque_bias", "sensing", bias="N m")
def torque_bias(world: World, draw: Draw) -> Outcome:
    """Return an offset of the torque sensor, on top of its calibration error."""
    bias = draw.sign() * draw.size(0.05, 0.25) * max(draw.scales.joint_torque, 4.0)
    return on_sensing(world, bias=bias), {"bias": bias}


@row("torque_delay", "sensing", delay="s")
def torque_delay(world: World, draw: Draw) -> Outcome:
    """Return a late torque sensor."""
    delay = draw.size(2e-3, 8e-3)
    return on_sensing(world, delay=delay), {"delay": delay}


def _channels(structure: Structure) -> Places:
    return ("i", "q_m", "tau") if structure.is_locked else ("i", "q_m", "q_l", "tau")


@row("quantization", "sensing", _channels, resolution="unit of the channel")
def quantization(world: World, draw: Draw) -> Outcome:
    """Return a channel that is coarser than stated."""
    j = CHANNELS.index(draw.place)
    stated, spread = world.resolution[j], max(world.resolution[j], world.noise[j])
    step = stated + draw.size(8.0, 40.0) * spread
    values = (*world.resolution[:j], step, *world.resolution[j + 1 :])
    return replace(world, resolution=values), {"resolution": step}


@row("noise", "sensing", _channels, noise="unit of the channel")
def noise(world: World, draw: Draw) -> Outcome:
    """Return a channel that is noisier than stated."""
    j = CHANNELS.index(draw.place)
    std = world.noise[j] * (1.0 + draw.size(4.0, 20.0))
    return replace(world, noise=(*world.noise[:j], std, *world.noise[j + 1 :])), {"noise": std}


# ------------------------------------------------------------------ load


@row("load_inertia", "load", with_load, I_l="kg m^2")
def load_inertia(world: World, draw: Draw) -> Outcome:
    """Return a different inertia of the load."""
    value = world.plant.I_l * draw.ratio(0.12, 0.5)
    return on_plant(world, I_l=value), {"I_l": value}


@row("load_coulomb", "load", with_load, d_cl="N m")
def load_coulomb(world: World, draw: Draw) -> Outcome:
    """Return set-valued Coulomb friction of the load."""
    level = draw.size(0.05, 0.25) * draw.scales.joint_torque
    return on_plant(world, up_l=level, down_l=level), {"d_cl": level}


@row("gravity", "load", with_load, torque="N m", angle="rad")
def gravity(world: World, draw: Draw) -> Outcome:
    """Return a load with the gravity torque -torque sin(q_l - angle).

    Three joints in ten start with the load hanging straight down.
    """
    size = draw.size(0.2, 0.8) * draw.scales.joint_torque
    q_0 = 0.0 if draw.rng.random() < 0.3 else float(draw.rng.uniform(-0.7, 0.7))
    seen = q_0 + world.sensing.zero_m  # from which a diagnosis counts all angles
    return on_plant(world, m_g_l=size, q_0=q_0), {"torque": size, "angle": seen}


KNOWN = table(dict(globals()))
"""The thirty rows, by the contract's names."""
