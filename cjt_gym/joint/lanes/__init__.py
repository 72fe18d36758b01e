"""The fast lanes: the most common joints, sixteen side by side in vector registers.

`advance` moves joints by one control step and returns how many it could not handle; these are left
to `cjt_gym.joint.kernel`, which handles every joint. That kernel is the reference: the lanes solve
the same equations by the same scheme, and `tests/physics/test_blocks.py` compares the two.

==============  ====================================================================
`blocks`        which joints can use the lanes; copying to and from them: `advance`
`substeps`      the substeps of a control step, written as if for one joint
`vectors`       vectors of numbers that compiled code uses like floats
`vector_math`   their sine, cosine and exponential function
==============  ====================================================================
"""

from cjt_gym.joint.lanes.blocks import Blocks, advance, advance_blocks, kind_of, make_blocks
from cjt_gym.joint.lanes.substeps import Kind

__all__ = ["Blocks", "Kind", "advance", "advance_blocks", "kind_of", "make_blocks"]
