"""Work side by side through joblib: on this machine, or on the workers of a Ray or Dask cluster."""

from __future__ import annotations

import os
from contextlib import AbstractContextManager
from importlib import import_module
from typing import Any

from cjt_gym.errors import ConfigurationError

BACKENDS = ("loky", "ray", "dask")


def cluster(backend: str, jobs: int) -> AbstractContextManager[Any]:
    """Return joblib's context for a backend, with its cluster."""
    from joblib import parallel_config

    count = (os.cpu_count() or 1) if jobs < 1 else jobs
    try:
        if backend == "ray":
            join_ray(count)
            import_module("ray.util.joblib").register_ray()
        elif backend == "dask":
            address = os.environ.get("DASK_SCHEDULER_ADDRESS")
            here: dict[str, Any] = {} if address else {"n_workers": count, "threads_per_worker": 1}
            import_module("distributed").Client(address, dashboard_address=None, **here)
    except ModuleNotFoundError as error:
        raise ConfigurationError(
            f'--backend {backend} needs {error.name}: pip install "cjt-gym[{backend}]".'
        ) from None
    threads: dict[str, Any] = {"inner_max_num_threads": 1} if backend == "loky" else {}
    context: AbstractContextManager[Any] = parallel_config(backend, **threads)
    return context


def join_ray(workers: int | None = None) -> Any:
    """Return Ray, connected to the cluster of `RAY_ADDRESS`, else to one on this machine."""
    ray = import_module("ray")
    if not ray.is_initialized():
        here = {} if "RAY_ADDRESS" in os.environ else {"num_cpus": workers or os.cpu_count()}
        ray.init(include_dashboard=False, log_to_driver=False, **here)
    return ray
