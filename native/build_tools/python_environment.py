"""The Pythons: .venv, others for newer Blenders, and Blenders that come as Python packages.

.venv holds all that building, testing and the demo need, in Python 3.11. Blender 5.1 and later need
a newer Python, which Debian 12 hasn't: it comes from a Maven repository, which has it as a package
of its own, and stands in `build/python`. So do the Pythons of other systems.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import ssl
import struct
import sys
import threading
import zipfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from . import paths
from .running import SetupError, child_environment, digest, is_fresh, run, step
from .system import project

# Blenders that come as a Python package, and the Python that each is built for.
BLENDERS = {"4.2": "3.11", "4.5": "3.11", "5.0": "3.11", "5.1": "3.13", "5.2": "3.13"}
# The one in .venv (pyproject.toml names it too): the demo runs in it, and it packs the add-on.
MAIN_BLENDER = "5.0"
# What the Maven repository calls the system that this is.
_HERE = "linux-x86_64"

_setting_up = threading.Lock()


@dataclass(frozen=True)
class Environment:
    """A virtual environment."""

    version: str
    folder: Path

    @property
    def python(self) -> Path:
        return self.folder / "bin" / "python"

    @property
    def site_packages(self) -> Path:
        return self.folder / "lib" / f"python{self.version}" / "site-packages"

    @property
    def tag(self) -> str:
        """As in the names of wheels."""
        return "cp" + self.version.replace(".", "")

    def pip_install(self, *what: str | Path) -> None:
        # Python compiles what it imports; all that is installed takes as long as installing it.
        options = ("--no-input", "--progress-bar", "off", "--no-compile")
        run(f"pip-{self.version}", self.python, "-m", "pip", "install", *options, *what)

    def fill(
        self, base: str | Path, requirements: Iterable[str], title: str, part: str = "requirements"
    ) -> None:
        """Makes it with the Python `base` and installs `requirements`, where that wasn't done.

        Those that are names in the table of what is shipped are installed from the very files that
        it names. `part` names what is installed by itself.
        """
        requirements = list(requirements)
        pinned = [name for name in requirements if name in pins()]
        key = digest(self.version, str(base), *requirements, *(str(pins()[n]) for n in pinned))
        stamp, unfinished = self.folder / f"{part}.stamp", self.folder / "unfinished"
        if is_fresh(stamp, key) and not unfinished.exists():
            return
        # pip takes what an interrupted run has left for complete, so that means a new start.
        if not (self.python.exists() and self.site_packages.exists()) or unfinished.exists():
            run("venv", base, "-m", "venv", "--clear", self.folder)
        with step(title):
            unfinished.touch()
            for name in pinned:
                self.pip_install(*pins()[name].options())
            self.pip_install(*(name for name in requirements if name not in pinned))
            unfinished.unlink()
        stamp.write_text(key)


@dataclass(frozen=True)
class Pin:
    """The one file of a package of which parts are given to others."""

    name: str
    version: str
    hash: str

    def options(self) -> list[str | Path]:
        """Words for pip, which refuses any other file."""
        path = paths.BUILD / "pins" / f"{self.name}.txt"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"{self.name}=={self.version} --hash={self.hash}\n")
        return ["--no-deps", "--require-hashes", "--only-binary=:all:", "-r", path]


def pins() -> dict[str, Pin]:
    """What parts of are given to others, from pyproject.toml."""
    return {name: Pin(name, *words.split()) for name, words in table("shipped").items()}


def main_environment() -> Environment:
    """.venv."""
    return Environment("3.11", paths.VENV)


def table(name: str) -> dict[str, Any]:
    """A table of what has to be installed, from pyproject.toml."""
    return dict(project()["tool"]["pointmorph"][name])


def set_up_building(extra: Iterable[str]) -> None:
    """Makes .venv and fills it with what building the library needs, and with `extra`."""
    requirements = ["pybind11", *project()["dependency-groups"]["build"], *extra]
    title = "Python packages to build with"
    main_environment().fill(sys.executable, requirements, title, "building")


def set_up_python() -> None:
    """Fills .venv with all else that pyproject.toml asks for."""
    requirements = list(project()["project"]["dependencies"])
    groups = project()["dependency-groups"]
    for group in ("build", "blender", "demo", "test"):
        requirements += groups[group]
    title = "Python packages, Blender's among them (about 500 MB to fetch)"
    main_environment().fill(sys.executable, requirements, title)


def set_up_other_python(version: str) -> Environment:
    """A Python that this system hasn't, with what testing in it needs."""
    environment = Environment(version, paths.BUILD / "python" / version / "venv")
    base = fetch_cpython(version, "linux-x86_64") / f"python{version}"
    with _setting_up:
        requirements = project()["dependency-groups"]["other-python"]
        environment.fill(base, requirements, f"packages for Python {version}")
    return environment


def fetch_cpython(version: str, system: str) -> Path:
    """The folder of a Python for that system, which a Maven repository has packed as a zip."""
    artifact = f"{table('cpython')[version]}:jar:{system}"
    # This system's stands where it always stood: virtual environments refer to it.
    folder = paths.BUILD / "python" / (version if system == _HERE else f"{version}-{system}")
    with _setting_up:
        return _fetched(artifact, system, folder, f"Python {version} for {system}")


def _fetched(artifact: str, system: str, folder: Path, title: str) -> Path:
    unpacked, stamp = folder / "cpython", folder / "stamp"
    root = unpacked / "org" / "bytedeco" / "cpython" / system
    if is_fresh(stamp, artifact):
        return root
    with step(f"{title} (about 25 MB to fetch)"):
        shutil.rmtree(folder, ignore_errors=True)
        copy = "org.apache.maven.plugins:maven-dependency-plugin:3.6.1:copy"
        options = (f"-Dartifact={artifact}", f"-DoutputDirectory={folder}")
        folder.mkdir(parents=True, exist_ok=True)
        environment = child_environment(MAVEN_OPTS=_trusting(folder / "trusted.jks"))
        run("maven", "mvn", "--batch-mode", copy, *options, environment=environment)
        [archive] = folder.glob("*.jar")
        with zipfile.ZipFile(archive) as content:
            content.extractall(unpacked)
        archive.unlink()
        if not root.is_dir():
            raise SetupError(f"{artifact} has no {root.relative_to(unpacked)}.")
        for program in root.glob("python*"):
            program.chmod(0o755)
        stamp.write_text(artifact)
    return root


def _trusting(store: Path) -> str:
    """What has Java trust whom this system trusts, as pip does: it reads no certificates as text,
    and keeps a list of its own that may know fewer.

    Writes them to `store`, in the simplest of Java's formats.
    """
    known = os.environ.get("SSL_CERT_FILE") or ssl.get_default_verify_paths().cafile
    if known is None or not Path(known).is_file():
        return os.environ.get("MAVEN_OPTS", "")
    pattern = "-----BEGIN CERTIFICATE-----.*?-----END CERTIFICATE-----"
    found = re.findall(pattern, Path(known).read_text(errors="replace"), re.DOTALL)

    def text(words: str) -> bytes:
        return struct.pack(">H", len(words)) + words.encode()

    content = struct.pack(">III", 0xFEEDFEED, 2, len(found))
    for number, certificate in enumerate(map(ssl.PEM_cert_to_DER_cert, found)):
        content += struct.pack(">I", 2) + text(f"trusted {number}") + struct.pack(">Q", 0)
        content += text("X.509") + struct.pack(">I", len(certificate)) + certificate
    password = "changeit"  # Java's own; it protects against accidents alone
    salt = password.encode("utf-16-be") + b"Mighty Aphrodite"
    store.write_bytes(content + hashlib.sha1(salt + content).digest())
    names = {"trustStore": store, "trustStoreType": "JKS", "trustStorePassword": password}
    options = [f"-Djavax.net.ssl.{name}={value}" for name, value in names.items()]
    return " ".join([*options, os.environ.get("MAVEN_OPTS", "")]).strip()


def set_up_peers() -> None:
    """What `bench --peers` compares with: an extra, which neither the build nor the tests need."""
    requirements = project()["project"]["optional-dependencies"]["peers"]
    stamp, key = paths.VENV / "peers.stamp", digest(sys.version, *requirements)
    if not is_fresh(stamp, key):
        with step("peers' Python packages (about 100 MB to fetch)"):
            main_environment().pip_install(*requirements)
            stamp.write_text(key)


def environment_of(blender: str) -> Environment:
    """The environment whose Python a Blender needs."""
    main = main_environment()
    version = BLENDERS[blender]
    return main if version == main.version else set_up_other_python(version)


def set_up_bpy(version: str) -> tuple[Path, str]:
    """A Blender as a Python package: the Python that it needs, and what PYTHONPATH has to name."""
    environment = environment_of(version)
    if version == MAIN_BLENDER:
        return environment.python, ""
    folder = paths.BUILD / "bpy" / version
    if not folder.exists():
        with step(f"Blender {version} as a Python package (about 350 MB to fetch)"):
            unfinished = folder.with_name(f"{version}.unfinished")
            shutil.rmtree(unfinished, ignore_errors=True)
            # What it needs is in the environment already.
            options = ("--no-deps", "--no-compile", "--target", unfinished)
            environment.pip_install(*options, f"bpy=={version}.*")
            unfinished.rename(folder)
    return environment.python, str(folder)
