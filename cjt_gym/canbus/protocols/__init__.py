"""Drive protocols: one file and one row for each.

:data:`PROTOCOLS` holds the rows; :mod:`~cjt_gym.canbus.protocols.contract` defines a protocol.
"""

from typing import Final

from cjt_gym.canbus.protocols.cia402_firmware import CIA402
from cjt_gym.canbus.protocols.dbc_firmware import DBC
from cjt_gym.canbus.protocols.mit_firmware import MIT
from cjt_gym.canbus.protocols.moteus_firmware import MOTEUS
from cjt_gym.canbus.protocols.odrive_firmware import ODRIVE
from cjt_gym.canbus.protocols.row import DriveProtocol, settings_of
from cjt_gym.errors import check_name

__all__ = ["PROTOCOLS", "protocol_of", "settings_of"]

PROTOCOLS: Final[dict[str, DriveProtocol]] = {
    row.name: row for row in (MIT, ODRIVE, MOTEUS, CIA402, DBC)
}
"""All protocols by their names."""


def protocol_of(name: str) -> DriveProtocol:
    """Return a protocol by name.

    Raises:
        UnknownNameError: There is no such protocol.
    """
    check_name("protocol", name, PROTOCOLS)
    return PROTOCOLS[name]
