"""Plain data as TOML, under the name that run pages import."""

from cjt_gym.disk import to_toml

__all__ = ["to_toml"]
