"""Python modules of what the package doesn't reach, for pictures and measurements."""

import importlib.util
import subprocess
import sys
import sysconfig
from pathlib import Path
from types import ModuleType


def compiled(name: str, folder: Path, built: Path, *settings: str) -> ModuleType:
    """The module that the folder's CMakeLists.txt makes in `built`, made again if it has changed.

    SystemExit with what the compiler says where it can't be made.
    """
    packages = sysconfig.get_path("platlib")
    prefix = f"-DCMAKE_PREFIX_PATH={packages}/pybind11;{packages}/cmeel.prefix"
    configure = ["cmake", "-S", str(folder), "-B", str(built), "-G", "Ninja", *settings]
    configure += [f"-DPython_EXECUTABLE={sys.executable}", prefix, "-DCMAKE_BUILD_TYPE=Release"]
    for command in (configure, ["cmake", "--build", str(built)]):
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            raise SystemExit(done.stdout + done.stderr)
    [path] = built.glob(f"{name}*.so")
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
