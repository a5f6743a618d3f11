"""A real Slurm on this machine alone: one node, in a folder, without accounting or systemd."""

from __future__ import annotations

import contextlib
import getpass
import os
import shutil
import socket
import subprocess
import time
from pathlib import Path

PROGRAMS = ("munged", "slurmctld", "slurmd", "sbatch", "squeue", "scontrol", "scancel")

# A requeued task waits for as long as credentials hold, and for the next look at the queue.
_CONFIGURATION = """
ClusterName=pointmorph
SlurmctldHost={host}(127.0.0.1)
SlurmUser={user}
SlurmdUser={user}
SlurmctldPort={ports[0]}
SlurmdPort={ports[1]}
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket,cred_expire=20
CredType=cred/munge
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SchedulerType=sched/backfill
SchedulerParameters=batch_sched_delay=0,sched_min_interval=0,sched_interval=1,bf_interval=1
SlurmdParameters=config_overrides
MailProg=/bin/true
MpiDefault=none
JobRequeue=1
KillWait=30
ReturnToService=2
NodeName={host} NodeAddr=127.0.0.1 CPUs={cpus} State=UNKNOWN
PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE State=UP
"""


def why_not() -> str | None:
    """Why there can be no Slurm here, in words."""
    if os.geteuid() != 0:
        return "Slurm's daemons need root"
    path = f"{os.environ.get('PATH', '')}:/usr/sbin:/sbin"
    missing = [name for name in PROGRAMS if shutil.which(name, path=path) is None]
    return f"Slurm isn't installed (no {', '.join(missing)})" if missing else None


class Cluster:
    """A running Slurm. Its commands find it by `environment`."""

    def __init__(self, folder: Path, cpus: int = 4) -> None:
        self.folder = folder
        self._daemons: list[subprocess.Popen[bytes]] = []
        sbin = f"{os.environ['PATH']}:/usr/sbin:/sbin"
        self.environment = {**os.environ, "PATH": sbin, "SLURM_CONF": str(folder / "slurm.conf")}
        for name in ("state", "spool"):
            (folder / name).mkdir()
        (folder / "munge.key").write_bytes(os.urandom(1024))
        (folder / "munge.key").chmod(0o600)
        folder.chmod(0o755)
        configuration = _CONFIGURATION.format(
            host=socket.gethostname().partition(".")[0], user=getpass.getuser(), folder=folder,
            ports=_free_ports(2), cpus=cpus,
        )  # fmt: skip
        (folder / "slurm.conf").write_text(configuration)

    def start(self) -> None:
        """Raises TimeoutError, with the ends of all logs, if it doesn't."""
        munge = ["--force", "--foreground", f"--key-file={self.folder / 'munge.key'}"]
        munge += [f"--{kind}={self.folder / 'munge'}.{suffix}" for kind, suffix in
                  (("socket", "socket"), ("pid-file", "pid"), ("seed-file", "seed"),
                   ("log-file", "log"))]  # fmt: skip
        self._daemon("munged", *munge)
        self._until(lambda: (self.folder / "munge.socket").exists())
        self._daemon("slurmctld", "-D", "-c")
        self._daemon("slurmd", "-D", "-c")
        self._until(lambda: "idle" in self.ask("sinfo", "-h", "-o", "%T"))

    def stop(self) -> None:
        """Cancels what runs, and ends the daemons, the last one first."""
        self.ask("scancel", f"--user={getpass.getuser()}")
        with contextlib.suppress(TimeoutError):
            self._until(lambda: not self.ask("squeue", "-h"), seconds=15)
        for daemon in reversed(self._daemons):
            daemon.terminate()
            try:
                daemon.wait(10)
            except subprocess.TimeoutExpired:
                daemon.kill()
                daemon.wait()

    def ask(self, *words: str) -> str:
        """What a command of Slurm's prints."""
        done = subprocess.run(words, env=self.environment, capture_output=True, text=True)
        return done.stdout.strip()

    def until_over(self, seconds: float = 100.0) -> None:
        """Waits until nothing is left in the queue."""
        self._until(lambda: not self.ask("squeue", "-h"), seconds)

    def processor_seconds(self) -> float:
        """Of the daemons, and of what they have waited for."""
        stats = [Path(f"/proc/{one.pid}/stat").read_text() for one in self._daemons]
        taken = [stat.rpartition(")")[2].split()[11:15] for stat in stats]
        return sum(int(ticks) for four in taken for ticks in four) / os.sysconf("SC_CLK_TCK")

    def _daemon(self, *words: str) -> None:
        with (self.folder / f"{words[0]}.out").open("wb") as log:
            self._daemons.append(
                subprocess.Popen(words, env=self.environment, stdout=log, stderr=log)
            )

    def _until(self, holds: object, seconds: float = 30.0) -> None:
        assert callable(holds)
        deadline = time.monotonic() + seconds
        while not holds():
            if time.monotonic() > deadline:
                raise TimeoutError(self._logs())
            time.sleep(0.1)

    def _logs(self) -> str:
        logs = [*self.folder.glob("*.out"), *self.folder.glob("*.log")]
        texts = (f"{p.name}: {p.read_text(errors='replace')[-1500:]}" for p in logs)
        return "\n".join([self.ask("squeue"), *texts])


def _free_ports(count: int) -> list[int]:
    with contextlib.ExitStack() as stack:
        sockets = [stack.enter_context(socket.socket()) for _ in range(count)]
        for one in sockets:
            one.bind(("127.0.0.1", 0))
        return [one.getsockname()[1] for one in sockets]
