"""Joint files, one TOML file per joint; data only. Read them with `cjt_gym.load_joint`."""

if __name__ != "cjt_gym.params":
    raise ImportError("This folder is installed as cjt_gym.params: import it under that name.")
