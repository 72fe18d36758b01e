"""Joint files: reading and writing them, and the ones that ship with the package."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path

from cjt_gym.disk.text import read_text
from cjt_gym.errors import MissingFileError, ParameterError, unknown_name
from cjt_gym.joint.parameters import JointParameters, content_of, sha256_of
from cjt_gym.joint.quantity import FrozenMapping, Quantity, Setting
from cjt_gym.joint.toml_format import Document, parse_document, write_document

__all__ = ["JointFile", "joint_names", "load_joint_file", "to_toml"]


@dataclass(frozen=True)
class JointFile:
    """All that a joint file says.

    Attributes:
        parameters: The validated parameters.
        effects: Settings by effect name, then by key: quantities, or texts such as "body". Their
            names are checked by the effect table, not here.
        sensors: "resolution" and "noise" by channel.
        sampling: "dt", "dt_electrical" and "jitter".
    """

    parameters: JointParameters
    effects: Mapping[str, Mapping[str, Setting]] = field(default_factory=FrozenMapping)
    sensors: Mapping[str, Mapping[str, Quantity]] = field(default_factory=FrozenMapping)
    sampling: Mapping[str, Quantity] = field(default_factory=FrozenMapping)

    def __post_init__(self) -> None:
        object.__setattr__(
            self, "effects", FrozenMapping({k: FrozenMapping(v) for k, v in self.effects.items()})
        )
        object.__setattr__(
            self, "sensors", FrozenMapping({k: FrozenMapping(v) for k, v in self.sensors.items()})
        )
        object.__setattr__(self, "sampling", FrozenMapping(self.sampling))

    @property
    def name(self) -> str:
        """Name of the joint."""
        return self.parameters.name

    def hash_hex(self) -> str:
        """Return the SHA-256 over axis, parameters, effects, sensors and sampling, in hexadecimal.

        Names, sources and tolerances do not count: they change no simulation.
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
    """Return the names of the joints that ship with the package."""
    folder = resources.files("cjt_gym.params")
    return tuple(
        sorted(
            entry.name[: -len(".toml")]
            for entry in folder.iterdir()
            if entry.name.endswith(".toml")
        )
    )


def load_joint_file(name_or_path: str | Path) -> JointFile:
    """Read and check a joint file.

    Args:
        name_or_path: Name of a joint that ships with the package (see `joint_names`), or path of
            a TOML file.

    Raises:
        UnknownNameError: No joint of this name ships with the package.
        MissingFileError: There is no file at this path.
        ParameterError: The file breaks the format, or a parameter is out of range.

    Example:
        >>> load_joint_file("orange_80_6000").parameters.k_b
        6000.0
    """
    if _is_path(name_or_path):
        path = Path(name_or_path).expanduser()
        return _from_document(parse_document(_read(path), str(name_or_path)), str(name_or_path))
    name = str(name_or_path)
    if name not in joint_names():
        raise unknown_name("joint", name, joint_names())
    text = (resources.files("cjt_gym.params") / f"{name}.toml").read_text(encoding="utf-8")
    origin = f"params/{name}.toml"
    return _from_document(parse_document(text, origin), origin)


def to_toml(joint_file: JointFile) -> str:
    """Return the text of a joint file that `load_joint_file` reads back to an equal one."""
    p = joint_file.parameters
    document = Document(
        name=p.name,
        source=p.source,
        axis=p.axis,
        parameters=FrozenMapping(p.quantities),
        effects=FrozenMapping(
            {name: FrozenMapping(entries) for name, entries in joint_file.effects.items()}
        ),
        sensors=FrozenMapping(
            {name: FrozenMapping(entries) for name, entries in joint_file.sensors.items()}
        ),
        sampling=FrozenMapping(joint_file.sampling),
    )
    return write_document(document)


def _is_path(name_or_path: str | Path) -> bool:
    if isinstance(name_or_path, Path):
        return True
    return name_or_path.endswith(".toml") or "/" in name_or_path or "\\" in name_or_path


def _read(path: Path) -> str:
    try:
        return read_text(path, ParameterError)
    except FileNotFoundError as error:
        raise MissingFileError(
            f"The joint file {path} does not exist. Give the path of a TOML file or one of: "
            f"{', '.join(joint_names())}."
        ) from error
    except (OSError, ParameterError) as error:
        raise ParameterError(
            f"The joint file {path} cannot be read: {error}. It must be a UTF-8 text file."
        ) from error


def _from_document(document: Document, origin: str) -> JointFile:
    parameters = JointParameters(
        document.name, document.source, document.parameters, document.axis, origin
    )
    return JointFile(parameters, document.effects, document.sensors, document.sampling)
