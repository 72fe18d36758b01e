"""Trained policies without what trained them: files that a control loop can afford.

=============  ===============================================================
`network`      a policy as matrices and biases, and what they act on
`base`         the controller that it adds to
`exported`     all of it in one file of arrays (`.npz`), read back without torch
`stepper`      such a file at work
`onnx_file`    the same as an ONNX graph
`c_header`     the same as a C header without dependencies
`export`       writes these files, and tries whether they do what the policy does
=============  ===============================================================

    cjt-gym export runs/ppo --to c --out policy.h
"""
