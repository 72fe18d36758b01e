"""Joints on a CAN bus: drives, a plant behind the contract of simulated ones, and an emulator.

`CanPlant` is a real joint, or an emulated one, as a plant; `load_hardware` reads the file that
describes it; `Emulator` is a drive with a simulated joint behind it.
"""
