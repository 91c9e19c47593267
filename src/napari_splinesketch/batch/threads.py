"""One thread of arithmetic a process, so that N processes share N cores."""

import os
from collections.abc import Iterator, MutableMapping
from contextlib import contextmanager

ONE_EACH = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
XLA, XLA_FLAG = "XLA_FLAGS", "--xla_cpu_multi_thread_eigen"


def limit_threads(environment: MutableMapping[str, str]) -> None:
    """Limit BLAS and XLA to one thread, unless the user has chosen; call before importing them.

    The environment is changed in place.
    """
    for name in ONE_EACH:
        environment.setdefault(name, "1")
    chosen = environment.get(XLA, "")
    if XLA_FLAG not in chosen:
        environment[XLA] = f"{chosen} {XLA_FLAG}=false".strip()


@contextmanager
def one_thread_each() -> Iterator[None]:
    """Let processes that are started inside inherit the limit; this one keeps its threads."""
    before = {name: os.environ.get(name) for name in (*ONE_EACH, XLA)}
    limit_threads(os.environ)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
