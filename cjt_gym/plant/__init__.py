"""Plants: simulated joints behind the contract that real ones satisfy."""

from cjt_gym.plant.measurement import Law, Limits, Measurement, Plant
from cjt_gym.plant.randomization import Variation
from cjt_gym.plant.simulated import SimulatedPlant, limits_of

__all__ = ["Law", "Limits", "Measurement", "Plant", "SimulatedPlant", "Variation", "limits_of"]
