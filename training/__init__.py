"""Training, evaluation and benchmarks: what stands on top of environments and controllers."""

if __name__ != "cjt_gym.training":
    raise ImportError(
        "This folder is installed as cjt_gym.training: import that instead of 'training'."
    )
