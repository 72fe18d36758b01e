"""Plants: simulated joints, which are commanded and measured as real ones are."""

from cjt_gym.plant.measurement import Law, Limits, Measurement
from cjt_gym.plant.randomization import Variation
from cjt_gym.plant.simulated import SimulatedPlant, limits_of

__all__ = ["Law", "Limits", "Measurement", "SimulatedPlant", "Variation", "limits_of"]
