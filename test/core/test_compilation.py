"""All compiled code is compiled ahead."""

import importlib
import pkgutil

import imotor_ros.core
from imotor_ros.core.compilation import compile_all


def _kernels():
    for module in pkgutil.iter_modules(imotor_ros.core.__path__):
        loaded = importlib.import_module(f"imotor_ros.core.{module.name}")
        for name, value in vars(loaded).items():
            if hasattr(value, "py_func") and value.__module__ == loaded.__name__:
                yield f"{module.name}.{name}", value


def test_no_kernel_is_left_for_the_first_run_to_compile():
    assert {name for name, _ in compile_all()} >= {"closed form", "power series", "stepping"}
    kernels = dict(_kernels())
    assert len(kernels) > 20
    # what other kernels call is compiled with them, and comes with them from the cache
    called = {name for kernel in kernels.values() for name in kernel.py_func.__code__.co_names}
    left = [name for name, kernel in kernels.items() if not kernel.signatures]
    assert [name for name in left if name.split(".")[1] not in called] == []
