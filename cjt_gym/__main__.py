"""`python -m cjt_gym` is the command `cjt-gym`."""

from cjt_gym.cli import main

if __name__ == "__main__":
    raise SystemExit(main())
