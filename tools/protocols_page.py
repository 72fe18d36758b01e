"""Writes docs/protocols.md out of the tables of the protocols: python -m tools.protocols_page."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from textwrap import dedent, fill

from cjt_gym.canbus.protocols import PROTOCOLS, dbc_mapping
from cjt_gym.canbus.protocols.contract import CHANNELS
from cjt_gym.canbus.protocols.layout import Field
from cjt_gym.canbus.protocols.mit import MODELS
from cjt_gym.canbus.protocols.row import DriveProtocol, Register
from tools.written import write_or_check

PAGE = Path(__file__).parents[1] / "docs" / "protocols.md"
HEAD = """# Drive protocols

<!-- Written by `python -m tools.protocols_page`; change the tables of the protocols instead. -->

The protocols that drives use on a CAN bus. Each is one file and one row in
`cjt_gym/canbus/protocols/`; its codec, its emulated drive, its tests and this page are generated
from the same table. Install with `pip install "cjt-gym[can]"`.

A configuration names the protocol and gives sign, zero and gear ratio of the drive's angle:

```toml
[drive]
protocol = "odrive"
node = 1
sign = -1          # the drive counts in the opposite direction
offset = 0.3       # its reading where the joint's angle is zero [rad, at the drive's shaft]
gear_ratio = 100   # default: n of the joint if it counts at the motor, 1 at the output
```

This means `q_m = sign * (angle - offset) / gear_ratio` and `tau_m = sign * torque * gear_ratio`.
Everything above the protocol is in SI units and on the link side, as in records. Nodes report these
channels:

{channels}

| protocol | | counts at | CAN FD | nodes | a command enables | peers in the tests |
|---|---|---|---|---|---|---|
{overview}

Sensors that are separate nodes have their own tables `[sensors.NAME]`, each with its protocol. A
sensor described by a DBC file needs only

```toml
[sensors.torque]
protocol = "dbc"
file = "torque_sensor"
```

`"torque_sensor"`, `"load_encoder"` and `"joint_sensor"`, which is both, come with the package,
and the emulator serves them. They are examples of sensors that send by themselves, once a
millisecond, with numbers of 32 bits (float, the lowest byte first): `TorqueSensor`, identifier
0x10000000 (29 bits), has the torque [N m] in bytes 0 to 3 and its status, 0 if in order, in byte
4; `LoadEncoder`, 0x10000001, has angle [rad] and velocity [rad/s]. What your own sensor sends
stands in its DBC file, with a mapping beside it as [below](#mappings).

A command enables: any command switches the drive on; it stays off only as long as none is sent.
Peers: the implementations that the frames are tested against, besides the manufacturers' documents.

## Traces

Bus traces, recorded by candump (`.log`) or as `.asc`, `.blf` or `.trc`, can be read as records:

```python
from cjt_gym.canbus.protocols import PROTOCOLS, settings_of
from cjt_gym.canbus.traces import read_trace

drive, sensor = PROTOCOLS["odrive"], PROTOCOLS["dbc"]
nodes = [
    (drive, settings_of(drive, {{"node": 1}}, n=100.0)),
    (sensor, settings_of(sensor, {{"file": "torque_sensor"}})),
]
records, repairs = read_trace("run.log", nodes, joint="orange_100_6000")
```

Commands become `tau_cmd`. With a DBC file of the bus beside the trace and a mapping, `read_log` and
`cjt-gym diagnose` read a trace like any other log: [records.md](records.md).
"""
PEERS = {
    "mit": "`mini-cheetah-motor-driver-socketcan`, a client by DFKI",
    "odrive": "the manufacturer's DBC file",
    "moteus": "`moteus`, the manufacturer's client",
    "cia402": "`canopen`: its node and its client for the profile",
    "dbc": "the manufacturer's DBC file against our ODrive",
}


def page() -> str:
    """Return the page."""
    channels = "\n".join(
        ["| channel | unit | |", "|---|---|---|"]
        + [f"| `{name}` | {unit} | {text} |" for name, (unit, text) in CHANNELS.items()]
    )
    overview = "\n".join(_overview(row) for row in PROTOCOLS.values())
    parts = [HEAD.format(channels=channels, overview=overview)]
    parts += ["\n".join(_section(row)) for row in PROTOCOLS.values()]
    return "\n".join(parts)


def _overview(row: DriveProtocol) -> str:
    low, high = row.nodes
    cells = (
        f"[`{row.name}`](#{row.name})",
        row.title,
        row.side,
        "yes" if row.fd else "no",
        f"{low} to {high}" if row.name != "dbc" else "by its identifiers",
        "yes" if row.command_enables else "no",
        PEERS[row.name],
    )
    return f"| {' | '.join(cells)} |"


def _section(row: DriveProtocol) -> Iterator[str]:
    yield f"## {row.name}\n"
    yield _filled(f"**{row.title}.** {_about(row)}")
    yield _filled(f"Before first use: {row.before}")
    yield "| option | default | |\n|---|---|---|"
    for name, option in row.options.items():
        choices = _choices(option.choices) if option.choices else ""
        yield f"| `{name}` | {_shown(option.default)} | {option.text}{choices} |"
    yield ""
    registers = row.registers()
    if registers:
        yield "| address | | name | holds | |\n|---|---|---|---|---|"
        named: set[tuple[str, ...]] = set()
        yield from (_register(register, named) for register in registers)
        yield ""
    if row.name == "mit":
        yield from _models()
    if row.name == "dbc":
        yield _about_mappings()


def _models() -> Iterator[str]:
    yield "| model | angle, ± [rad] | velocity, ± [rad/s] | torque, ± [N m] |\n|---|---|---|---|"
    for name, ends in MODELS.items():
        yield f"| {name} | {' | '.join(f'{end:g}' for end in ends)} |"
    yield ""


def _filled(text: str) -> str:
    paragraphs = [" ".join(each.split()) for each in text.split("\n\n")]
    lines = (fill(each, 100, break_long_words=False, break_on_hyphens=False) for each in paragraphs)
    return "\n\n".join(lines) + "\n"


def _about(row: DriveProtocol) -> str:
    """Return what the protocol's module says of it, without its first line."""
    module = sys.modules[row.master.__module__]
    text = (module.__doc__ or "").partition("\n")[2].strip()
    return dedent(text).replace("``", "`").replace("References:\n    ", "References: ")


def _about_mappings() -> str:
    text = (dbc_mapping.__doc__ or "").partition("\n")[2].strip()
    lines = (
        text.replace("``", "`")
        .replace(":mod:`cjt_gym.records.mapping`", "[records.md]")
        .split("\n")
    )
    plain = "\n".join(lines).replace("[records.md]", "[records.md](records.md#mapping)")
    before, _, rest = plain.partition("================")
    table, _, after = rest.rpartition("================")
    rows = [line for line in table.split("\n")[1:] if line.startswith(("`", " "))]
    made = ["| key of `[can]` | |", "|---|---|"]
    for line in rows:
        key, text = line[:18].strip(), line[18:].strip()
        if key:
            made.append(f"| {key} | {text} |")
        else:
            made[-1] = f"{made[-1][:-2]} {text} |"
    data = Path(dbc_mapping.__file__).parent / "data" / "example_drive.map.toml"
    example = data.read_text(encoding="utf-8").strip()
    tail = after.partition("\n")[2].strip()
    return (
        f"### Mappings\n\n{before.strip()}\n\n" + "\n".join(made) + f"\n\n{tail}\n\n"
        f"`example_drive`, which comes with the package:\n\n```toml\n{example}\n```\n"
    )


def _choices(choices: Sequence[object]) -> str:
    if isinstance(choices, range):
        return f" ({choices[0]} to {choices[-1]})"
    return f" ({', '.join(_shown(choice) for choice in choices)})"


def _shown(value: object) -> str:
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    if isinstance(value, str):
        return f'`"{value}"`'
    return f"`{list(value)}`" if isinstance(value, tuple) else f"`{value}`"


def _register(register: Register, named: set[tuple[str, ...]]) -> str:
    holds = "<br>".join(_field(field, named) for field in register.fields if field.name)
    return (
        f"| {register.address} | {register.direction} | {register.name} | {holds} "
        f"| {register.text} |"
    )


def _field(field: Field, named: set[tuple[str, ...]]) -> str:
    """Return a field in words; names of its numbers where they were not given before."""
    kind = f"{field.kind}{field.bits}"
    scale = ""
    if not field.plain:
        low, high = field.range
        scale = f", {low:.5g} to {high:.5g}"
    unit = f" [{field.unit}]" if field.unit else ""
    text = f": {field.text}" if field.text else ""
    names = ", ".join(f"{number} {name}" for number, name in field.names.items())
    key = tuple(field.names.values())
    listed = f" <small>({names})</small>" if names and key not in named else ""
    named.add(key)
    return f"{field.name} ({kind}{scale}){unit}{text}{listed}"


def main(words: Sequence[str] | None = None) -> int:
    """Write or check the page; return the exit status."""
    return write_or_check("tools.protocols_page", PAGE, page(), words)


if __name__ == "__main__":
    sys.exit(main())
