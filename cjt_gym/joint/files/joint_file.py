"""Joint files: reading and writing them, and the ones that ship with the package."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any

from cjt_gym.disk import Inline
from cjt_gym.disk import to_toml as write_tables
from cjt_gym.disk.text import read_text
from cjt_gym.errors import (
    MissingFileError,
    ParameterError,
    UnknownNameError,
    check_name,
    check_type,
    unknown_name,
)
from cjt_gym.joint.files.effect_entries import usual_effects
from cjt_gym.joint.files.mistakes import Mistakes
from cjt_gym.joint.files.parameter_table import AXES
from cjt_gym.joint.files.parameters import JointParameters, check_quantities, content_of, sha256_of
from cjt_gym.joint.files.quantity import FrozenMapping, Plain, Quantity, Setting, freeze
from cjt_gym.joint.files.toml_format import parse_document
from cjt_gym.joint.kernel.drives import DRIVES
from cjt_gym.joint.structures import STRUCTURES

__all__ = ["JointFile", "joint_names", "load_joint_file", "to_toml"]

TOOLBOX_SUFFIX = ".m"


@dataclass(frozen=True)
class JointFile:
    """The content of a joint file.

    Attributes:
        parameters: The validated parameters.
        effects: Settings by effect name, then by key: quantities, or texts such as "body". Their
            names are checked by the effect table, not here.
        sensors: "resolution" and "noise" by channel.
        sampling: "dt", "dt_electrical" and "jitter".
        structure: Structure of the joint unless another is asked for; None if the file names none.
        drive: Its drive, or None.
        found: What a diagnosis says of how it found the values, as plain data.
    """

    parameters: JointParameters
    effects: Mapping[str, Mapping[str, Setting]] = field(default_factory=FrozenMapping)
    sensors: Mapping[str, Mapping[str, Quantity]] = field(default_factory=FrozenMapping)
    sampling: Mapping[str, Quantity] = field(default_factory=FrozenMapping)
    structure: str | None = None
    drive: str | None = None
    found: Mapping[str, Plain] = field(default_factory=FrozenMapping)

    def __post_init__(self) -> None:
        for name in ("effects", "sensors"):
            frozen = {k: FrozenMapping(v) for k, v in getattr(self, name).items()}
            object.__setattr__(self, name, FrozenMapping(frozen))
        object.__setattr__(self, "sampling", FrozenMapping(self.sampling))
        object.__setattr__(self, "found", freeze(self.found))

    def __repr__(self) -> str:
        return f"<JointFile {self.name}, {self.parameters.origin}>"

    @property
    def name(self) -> str:
        """Name of the joint."""
        return self.parameters.name

    @property
    def path(self) -> Path | None:
        """The file that it was read from, an absolute path; None if it ships or is no file."""
        origin = self.parameters.origin
        if origin == f"params/{self.name}.toml" and self.name in joint_names():
            return None
        return Path(origin).resolve() if is_path(origin) and Path(origin).is_file() else None

    @property
    def gear_ratio(self) -> float | None:
        """Gear ratio n; None where the file gives none."""
        return self.parameters.n if "n" in self.parameters else None

    def hash_hex(self) -> str:
        """Return the SHA-256 over axis, parameters, effects, sensors and sampling, in hexadecimal.

        Names, sources and tolerances do not count: they change no simulation. Nor do structure and
        drive, which are only what the joint is unless told otherwise.
        """
        tables = {"effects": self.effects, "sensors": self.sensors}
        nested = {
            title: {
                name: {k: content_of(v) for k, v in entries.items()}
                for name, entries in table.items()
            }
            for title, table in tables.items()
        }
        sampling = {key: content_of(quantity) for key, quantity in self.sampling.items()}
        return sha256_of(self.parameters.content() | nested | {"sampling": sampling})


def joint_names() -> tuple[str, ...]:
    """Return the names of the shipped joints."""
    folder = resources.files("cjt_gym.params")
    names = (entry.name for entry in folder.iterdir())
    return tuple(sorted(n.removesuffix(".toml") for n in names if n.endswith(".toml")))


def load_joint_file(name_or_path: str | Path) -> JointFile:
    """Read and check a joint file.

    Args:
        name_or_path: Name of a joint that ships with the package (see `joint_names`), or path of
            a TOML file, or of a parameter file of the Compliant Joint Toolbox (`.m`).

    Raises:
        UnknownNameError: No joint of this name ships with the package.
        MissingFileError: There is no file at this path.
        ParameterError: The file breaks the format, or a parameter is out of range.
        ConfigurationError: It is neither a name nor a path.

    Example:
        >>> load_joint_file("orange_80_6000").parameters.k_b
        6000.0
    """
    check_type("joint", name_or_path, (str, Path), "the name of a joint or the path of its file")
    if is_path(name_or_path):
        path = Path(name_or_path).expanduser()
        if path.suffix == TOOLBOX_SUFFIX:
            from cjt_gym.joint.files.toolbox_files import read_toolbox

            return read_toolbox(name_or_path)
        return joint_file_of(read_joint_text(path), str(name_or_path))
    name = str(name_or_path)
    try:
        check_name("joint", name, joint_names())
    except UnknownNameError as error:
        if not Path(f"{name}.toml").is_file():
            raise
        raise UnknownNameError(f"{error} For the file in this folder, give {name}.toml.") from None
    text = (resources.files("cjt_gym.params") / f"{name}.toml").read_text(encoding="utf-8")
    return joint_file_of(text, f"params/{name}.toml")


def to_toml(joint_file: JointFile) -> str:
    """Return the text of a joint file that `load_joint_file` reads back to an equal one."""
    p = joint_file.parameters
    return write_tables(
        {
            "name": p.name,
            "source": p.source,
            "axis": None if p.axis == AXES[0] else p.axis,
            "structure": joint_file.structure,
            "drive": joint_file.drive,
            "parameters": _entries(p.quantities),
            "effects": {k: _entries(v) for k, v in joint_file.effects.items()} or None,
            "sensors": {k: _entries(v) for k, v in joint_file.sensors.items()} or None,
            "sampling": _entries(joint_file.sampling) or None,
            "found": joint_file.found or None,
        }
    )


def _entries(table: Mapping[str, Setting]) -> dict[str, Any]:
    """Return a table with its quantities on one line each."""
    return {k: _on_one_line(v) if isinstance(v, Quantity) else v for k, v in table.items()}


def _on_one_line(quantity: Quantity) -> Inline:
    return Inline(
        value=quantity.value,
        unit=quantity.unit,
        source=quantity.source or None,
        tolerance=quantity.tolerance,
        guess=True if quantity.guess and quantity.tolerance is None else None,
        low=quantity.low,
        high=quantity.high,
        asymmetric=quantity.asymmetric or None,
    )


def is_path(name_or_path: str | Path) -> bool:
    """Return whether this is the path of a file rather than the name of a shipped joint.

    Names have no ending, so that `elbow.tml` is a file that is missing rather than no joint.
    """
    if isinstance(name_or_path, Path):
        return True
    signs = "/" in name_or_path or "\\" in name_or_path or name_or_path.startswith(".")
    return signs or bool(Path(name_or_path).suffix)


def read_joint_text(path: Path) -> str:
    """Return the text of a joint file."""
    try:
        return read_text(path, ParameterError)
    except FileNotFoundError as error:
        place = "" if path.is_absolute() else f" in {Path.cwd()}"
        raise MissingFileError(
            f"The joint file {path} does not exist{place}. Give the path of a TOML "
            f"file or one of: {', '.join(joint_names())}."
        ) from error
    except OSError as error:
        raise ParameterError(
            f"The joint file {path} cannot be read: {error}. It must be a UTF-8 text file."
        ) from error


def joint_file_of(text: str, origin: str) -> JointFile:
    """Return the joint file for a text, or raise all of its mistakes at once."""
    mistakes = Mistakes(origin)
    content = parse_document(text, origin, mistakes)
    axis = content.pop("axis")
    for key, known in (("structure", STRUCTURES), ("drive", DRIVES)):
        name = content[key]
        if name is not None and name not in known:
            mistakes.found.append(f"{key} of {origin}: {unknown_name(key, name, known)}")
    quantities = content.pop("parameters")
    with mistakes.collected():
        check_quantities(quantities, axis, origin, not mistakes.found)
    content["effects"] = usual_effects(content["effects"], axis, origin, mistakes)
    mistakes.check()
    name, source = content.pop("name"), content.pop("source")
    return JointFile(JointParameters(name, source, quantities, axis, origin), **content)
