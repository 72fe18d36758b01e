"""The five structures: which of the three bodies move together, and which is held.

Every structure is the three-mass chain motor - gear - load seen through a selection
matrix S, q = S z (+ e_l q_l where the output is fixed), so that no structure repeats an
equation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cjt_gym.errors import check_name

BODIES = ("motor", "gear", "load")


@dataclass(frozen=True)
class Structure:
    """One way to join the three bodies.

    Attributes:
        name: Its name in every interface.
        groups: For motor, gear and load the index of the coordinate in z that moves the
            body; -1 where the body follows a prescribed motion.
        summary: One line for people.
    """

    name: str
    groups: tuple[int, int, int]
    summary: str

    @property
    def size(self) -> int:
        """Number of coordinates in z."""
        return max(self.groups) + 1

    @property
    def output_fixed(self) -> bool:
        """Whether the load's motion is an input rather than a result."""
        return self.groups[2] < 0

    @property
    def has_gear(self) -> bool:
        """Whether the gearbox is compliant."""
        return self.groups[0] != self.groups[1]

    @property
    def has_spring(self) -> bool:
        """Whether a torsion bar connects motor side and load."""
        return self.groups[1] != self.groups[2]

    @property
    def order(self) -> int:
        """Number of mechanical states: z, dz and, where it is an input, q_l."""
        return 2 * self.size + int(self.output_fixed)

    @property
    def selection(self) -> NDArray[np.float64]:
        """Selection matrix S, shape (3, size)."""
        matrix = np.zeros((3, self.size))
        for body, group in enumerate(self.groups):
            if group >= 0:
                matrix[body, group] = 1.0
        return matrix

    @property
    def needed_parameters(self) -> tuple[str, ...]:
        """The stiffnesses that this structure needs."""
        return ("k_g",) * self.has_gear + ("k_b",) * self.has_spring


STRUCTURES: dict[str, Structure] = {
    row.name: row
    for row in (
        Structure("full_dynamics", (0, 1, 2), "three masses, compliant gearbox, free load"),
        Structure("rigid_gearbox", (0, 0, 1), "motor and gear are one mass, free load"),
        Structure("rigid", (0, 0, 0), "one mass, no spring"),
        Structure("output_fixed", (0, 1, -1), "compliant gearbox, prescribed load motion"),
        Structure(
            "output_fixed_rigid_gearbox",
            (0, 0, -1),
            "motor and gear are one mass, prescribed load motion",
        ),
    )
}


def get_structure(name: str) -> Structure:
    """Return the structure of that name.

    Raises:
        UnknownNameError: There is none; the message suggests the nearest.
    """
    check_name("structure", name, STRUCTURES)
    return STRUCTURES[name]
