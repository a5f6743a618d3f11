"""A newer Debian beside this one, for its Blender with a window.

Its files are a plain folder, which stays. What is mounted in it while a command runs is mounted in
a namespace of that command alone: the kernel drops it with the last process, even after kill -9,
and this system never sees it. It takes root and a kernel that allows it; `why_not` says what lacks.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from . import paths
from .python_environment import table
from .running import SetupError, digest, is_fresh, run, say, step
from .targets import LINUX

_making = threading.Lock()

# What mounts a folder's system parts and then becomes the command; the first word is the folder,
# then come pairs of source and place for each folder of this system, an empty word, the command.
_INSIDE = """
set -e
root=$1; shift
mkdir -p "$root/proc" "$root/sys" "$root/dev/pts" "$root/dev/shm" "$root/tmp"
mount -t proc proc "$root/proc"
mount --rbind /sys "$root/sys"
for name in null zero full random urandom tty; do
    touch "$root/dev/$name"; mount --bind "/dev/$name" "$root/dev/$name"
done
mount -t tmpfs tmpfs "$root/dev/shm"
mount -t devpts devpts "$root/dev/pts" -o newinstance,ptmxmode=0666
while [ -n "$1" ]; do
    mkdir -p "$root$2"; mount --bind "$1" "$root$2"; shift 2
done
shift
exec chroot "$root" "$@"
"""


def _namespace() -> tuple[str, ...]:
    """The command in front of another that gives it mounts and processes of its own.

    They all end with the thread that waits for it, however that ends.
    """
    # Where the root isn't a mount, as in a chroot, it has no propagation to be changed.
    mounts_of_all = Path("/proc/self/mountinfo").read_text().splitlines()
    is_mount = any(line.split()[4] == "/" for line in mounts_of_all)
    propagation = "private" if is_mount else "unchanged"
    mounts = ("unshare", "--mount", "--propagation", propagation)
    return ("setpriv", "--pdeathsig", "KILL", *mounts, "--pid", "--fork", "--kill-child")


def why_not() -> str | None:
    """The reason why another Debian can't be made here; nothing where it can."""
    if os.geteuid() != 0:
        return "only root can make another Debian beside this one"
    for program in ("mmdebstrap", "setpriv", "unshare"):
        if shutil.which(program) is None:
            return f"there is no {program}, which makes another Debian beside this one"
    try_it = (*_namespace(), "sh", "-c", "mount -t tmpfs tmpfs /mnt")
    done = subprocess.run(try_it, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        return f"mounts of one's own aren't allowed here: {done.stderr.strip()}"
    return None


def folder(suite: str) -> Path:
    """Where a Debian's files are; POINTMORPH_DEBIAN names the folder above, for instance a cache
    that several checkouts share."""
    return Path(os.environ.get("POINTMORPH_DEBIAN", paths.BUILD / "debian")) / suite


def set_up(suite: str) -> Path:
    """The files of a Debian with the packages that pyproject.toml names; made where they aren't."""
    packages = table("other-debian")["packages"]
    root = folder(suite)
    stamp, key = root.with_suffix(".stamp"), digest(suite, *packages)
    root.parent.mkdir(parents=True, exist_ok=True)
    with _making, _alone(root):
        if not is_fresh(stamp, key):
            with step(f"Debian {suite} with its Blender (about 400 MB to fetch)"):
                stamp.unlink(missing_ok=True)
                # Under another name until it is whole; what a run that was killed has left goes.
                for left_over in (root, *root.parent.glob(f"{suite}.unfinished-*")):
                    shutil.rmtree(left_over, ignore_errors=True)
                unfinished = Path(tempfile.mkdtemp(prefix=f"{suite}.unfinished-", dir=root.parent))
                unfinished.chmod(0o755)
                run(f"debian-{suite}", *_namespace(), *_bootstrap(suite, packages, unfinished))
                unfinished.rename(root)
                stamp.write_text(key)
    if not any((root / "usr" / "bin" / f"python{version}").exists() for version in LINUX.pythons):
        raise SetupError(
            f"Debian {suite} has a Python that there is no wheel for; there are wheels for "
            f"{', '.join(LINUX.pythons)} (native/build_tools/targets.py)."
        )
    return root


def set_up_first(suites: Iterable[str]) -> str:
    """Sets up the first of some Debians that can be; returns its name."""
    *more, last = suites
    for suite in more:
        try:
            set_up(suite)
        except SetupError as error:
            say(f"  Debian {suite} can't be made, {last} is tried instead: {error}")
        else:
            return suite
    set_up(last)
    return last


@contextmanager
def _alone(root: Path) -> Iterator[None]:
    """Waits for another checkout that makes the same folder; a process that ends gives it free."""
    import fcntl  # only where there is a Debian to make

    with root.with_suffix(".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def _bootstrap(suite: str, packages: Iterable[str], root: Path) -> list[str]:
    apt = [
        'APT::Install-Recommends "false"',
        'Acquire::Retries "5"',
        # A mirror's copy may be older than its signature's end.
        'Acquire::Check-Valid-Until "false"',
        'Acquire::Check-Date "false"',
        *_proxies(),
    ]
    unneeded = [f"path-exclude=/usr/share/{name}/*" for name in ("doc", "info", "locale", "man")]
    options = [f"--aptopt={option}" for option in apt]
    options += [f"--dpkgopt={option}" for option in ("force-unsafe-io", *unneeded)]
    wanted = f"--include={','.join(packages)}"
    kind = ["--mode=root", "--variant=apt", "--format=directory"]
    return ["mmdebstrap", *kind, *options, wanted, suite, str(root), *_mirror()]


def _proxies() -> list[str]:
    """How this system's apt reaches what it fetches."""
    said = subprocess.run(["apt-config", "dump"], capture_output=True, text=True, check=False)
    lines = [line.strip().rstrip(";") for line in said.stdout.splitlines()]
    return [line for line in lines if line.startswith(("Acquire::http", "Acquire::https"))]


def _mirror() -> list[str]:
    """Where this system's own packages come from; nothing where that isn't known."""
    words = ("apt-get", "indextargets", "--format", "$(ORIGIN) $(SITE)", "Created-By: Packages")
    said = subprocess.run(words, capture_output=True, text=True, check=False)
    sites = [line.split()[1] for line in said.stdout.splitlines() if line.startswith("Debian ")]
    return sites[:1]


def inside(
    suite: str, command: Iterable[str | Path], shared: Iterable[Path], environment: dict[str, str]
) -> list[str]:
    """The words that run a command as root in a Debian, with folders of this system at the same
    place as here, and nothing in its environment but `environment`."""
    binds = [str(path) for path in shared for _ in range(2)]
    variables = {
        "HOME": "/root",
        "LANG": "C.UTF-8",
        "PATH": "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin",
        **environment,
    }
    settings = [f"{name}={value}" for name, value in variables.items()]
    shell = ["sh", "-c", _INSIDE, "sh", str(folder(suite)), *binds, ""]
    return [*_namespace(), *shell, "env", "-i", *settings, *map(str, command)]
