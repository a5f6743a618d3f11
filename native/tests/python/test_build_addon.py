"""The one entry: what it counts, what it notices and what it says."""

import contextlib
import importlib.util
import json
import os
import shutil
import ssl
import subprocess
import sys
import threading
import time
import tomllib
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import ModuleType

import pytest
from build_tools import (
    other_debian,
    packaging,
    paths,
    python_environment,
    reports,
    running,
    suites,
    system,
    targets,
    wheels,
    windows,
)
from build_tools.reports import Outcome

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture(autouse=True)
def _own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What the tools make lies in a folder of the test."""
    monkeypatch.setattr(paths, "BUILD", tmp_path)
    monkeypatch.setattr(paths, "LOGS", tmp_path / "logs")


@pytest.fixture
def entry() -> ModuleType:
    """build_addon.py as a module."""
    spec = importlib.util.spec_from_file_location("build_addon", ROOT / "build_addon.py")
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def pytest_report(folder: Path, source: str) -> tuple[int, Path]:
    """Status and report of a real pytest run over `source`."""
    (folder / "test_sample.py").write_text("import pytest\n" + source)
    report = folder / "report.xml"
    command = [sys.executable, "-m", "pytest", "-c", "/dev/null", str(folder / "test_sample.py")]
    done = subprocess.run([*command, f"--junitxml={report}"], check=False, capture_output=True)
    return done.returncode, report


def test_counts_passes_failures_errors_and_skips(tmp_path: Path) -> None:
    status, report = pytest_report(
        tmp_path,
        """
@pytest.fixture
def broken(): raise OSError("no fixture")
def test_good(): pass
@pytest.mark.parametrize("x", range(3))
def test_many(x): pass
def test_bad(): assert 1 == 2, "one is not two"
def test_error(broken): pass
def test_absent(): pytest.skip("no data")
""",
    )
    outcome = reports.judge(status, report)
    assert outcome.passed == 4
    assert len(outcome.failures) == 2
    assert any("test_bad" in line and "one is not two" in line for line in outcome.failures)
    assert outcome.skips == ["no data"]
    [left_out] = outcome.left_out
    assert left_out.endswith("test_absent: no data")


def test_a_whole_file_is_skipped_for_a_reason(tmp_path: Path) -> None:
    _, report = pytest_report(tmp_path, "pytest.importorskip('no_such_package')")
    [reason] = reports.judge(0, report).skips
    assert "could not import 'no_such_package'" in reason


def test_counts_google_test(tmp_path: Path) -> None:
    report = tmp_path / "report.xml"
    report.write_text("""<?xml version="1.0" encoding="UTF-8"?>
<testsuites tests="4" failures="1" disabled="1" errors="0" time="0.1" name="AllTests">
  <testsuite name="A" tests="4" failures="1" disabled="1" skipped="1" errors="0">
    <testcase name="Good" status="run" result="completed" classname="A" />
    <testcase name="DISABLED_Off" status="notrun" result="suppressed" classname="A" />
    <testcase name="Absent" status="run" result="skipped" classname="A">
      <skipped message="a.cpp:3&#x0A;no data"><![CDATA[a.cpp:3]]></skipped>
    </testcase>
    <testcase name="Bad" status="run" result="completed" classname="A">
      <failure message="a.cpp:7&#x0A;Expected" type=""></failure>
      <failure message="a.cpp:8&#x0A;Expected" type=""></failure>
    </testcase>
  </testsuite>
</testsuites>""")
    outcome = reports.judge(1, report)
    assert outcome.passed == 1
    assert len(outcome.failures) == 1
    assert outcome.failures[0].startswith("A.Bad")
    assert outcome.skips == ["disabled", "no data"]
    assert outcome.left_out == ["A.DISABLED_Off: disabled", "A.Absent: no data"]


@pytest.mark.parametrize(
    ("status", "source", "expected"),
    [
        (5, "", "ended with status 5"),
        (0, "@pytest.mark.skip\ndef test_absent(): pass", "ran no test"),
        (-11, "def test_good(): pass", "ended with status -11"),
    ],
)
def test_a_suite_that_did_not_really_pass_fails(
    tmp_path: Path, status: int, source: str, expected: str
) -> None:
    _, report = pytest_report(tmp_path, source)
    [failure] = reports.judge(status, report).failures
    assert expected in failure


def test_a_missing_report_is_a_failure(tmp_path: Path) -> None:
    [failure] = reports.judge(-11, tmp_path / "none.xml").failures
    assert "no report" in failure


def test_all_suites_run_and_the_last_line_is_the_sum(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def breaks() -> Outcome:
        raise running.SetupError("no compiler")

    def skips() -> Outcome:
        outcome = Outcome(3)
        outcome.skip("no data", "one", "other")
        return outcome

    known = {"first": suites.Suite(breaks), "second": suites.Suite(skips)}
    monkeypatch.setattr(suites, "SUITES", known)
    monkeypatch.setattr(suites, "set_up_all", lambda groups, install, fetches: [])
    assert suites.test(list(known), 1) == 1
    said = capsys.readouterr().out.splitlines()
    assert said[-1] == "3 passed, 1 failed, 2 skipped"
    assert "skipped 2 in second: no data" in said
    assert any("no compiler" in line for line in said)
    left_out = (paths.BUILD / "reports" / "left_out.txt").read_text().splitlines()
    assert left_out == ["second: one: no data", "second: other: no data"]

    assert suites.test(["second"], 1) == 0
    assert capsys.readouterr().out.splitlines()[-1] == "3 passed, 0 failed, 2 skipped"


def test_each_suite_gets_its_share_of_the_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "cpu_count", lambda: 8)
    for jobs, count, expected in ((2, 5, "4"), (8, 2, "4"), (16, 9, "1"), (1, 3, "8")):
        monkeypatch.setenv("OMP_NUM_THREADS", "")  # so that what is set below is taken back
        monkeypatch.delenv("OMP_NUM_THREADS")
        seen: list[str | None] = []

        def runs(seen: list[str | None] = seen) -> Outcome:
            seen.append(running.child_environment().get("OMP_NUM_THREADS"))
            return Outcome(1)

        suites.run_suites({str(k): suites.Suite(runs) for k in range(count)}, jobs)
        assert seen == [expected] * count


@pytest.mark.parametrize(("jobs", "together"), [(1, 1), (2, 3)])
def test_another_suite_runs_beside_one_that_waits(jobs: int, together: int) -> None:
    barrier = threading.Barrier(together)  # broken unless so many run side by side
    runners: set[int] = set()

    def runs() -> Outcome:
        runners.add(threading.get_ident())
        barrier.wait(60)
        return Outcome(1)

    known = {str(k): suites.Suite(runs, waits=k == 0) for k in range(2 * together)}
    assert suites.run_suites(known, jobs) == 0
    assert len(runners) == together


def test_the_slowest_tests_and_the_shares_of_suites_are_told_and_kept(tmp_path: Path) -> None:
    _, report = pytest_report(
        tmp_path, "def test_quick(): pass\ndef test_slow(): import time; time.sleep(0.3)"
    )
    read = reports.read_junit(report)
    slow = next(test for test in read.times if test.endswith("test_slow"))
    assert read.times[slow] >= 0.3
    many = Outcome(passed=30, times={f"test {i}": i / 1000 for i in range(30)}, processor=3.0)
    read.processor = 1.0
    said = reports.tell({"many": many, "few": read}, tmp_path)
    assert "20 slowest of 32" in said[0]
    assert said[1].endswith(f"few: {slow}")
    assert said[2].endswith("many: test 29")
    assert [line.split()[-2:] for line in said if line.startswith(("many", "few"))] == [
        ["75", "%"],
        ["25", "%"],
    ]
    assert json.loads((tmp_path / "times.json").read_text())["few"]["tests"] == read.times
    assert (tmp_path / "times.txt").read_text().splitlines() == said


def test_processor_time_is_that_of_the_commands() -> None:
    before = running.processor_seconds()
    busy = "import time\nwhile time.process_time() < 0.3: pass"
    running.run("log", sys.executable, "-c", busy)
    used = running.processor_seconds() - before
    assert used >= 0.3
    running.run("log", sys.executable, "-c", "import time; time.sleep(0.5)")
    assert running.processor_seconds() - before - used < 0.5


def test_a_failed_command_shows_the_end_of_its_log() -> None:
    command = (sys.executable, "-c", "print('line\\n' * 99, 'the reason'); raise SystemExit(3)")
    with pytest.raises(running.SetupError, match=r"status 3:\n(.*\n)*.*the reason"):
        running.run("log", *command)
    assert running.run("log", *command, check=False) == 3


def test_a_command_that_hangs_is_stopped() -> None:
    command = (sys.executable, "-c", "import time; time.sleep(60)")
    assert running.run("log", *command, timeout=0.2, check=False) < 0


@contextlib.contextmanager
def a_command_with_children(folder: Path) -> Iterator[list[str]]:
    """A command that waits for another; both must have ended afterward."""
    begun, word = folder / "begun", f"{folder.name}.{os.getpid()}"
    child = f'sh -c "touch {begun}; sleep 600; :" {word} & wait'
    yield ["sh", "-c", child, word]
    assert begun.exists()
    end = time.monotonic() + 60
    while is_running(word):
        assert time.monotonic() < end
        time.sleep(0.01)


def wait_for(path: Path) -> None:
    end = time.monotonic() + 60
    while not path.exists():
        assert time.monotonic() < end
        time.sleep(0.01)


def test_what_a_stopped_command_has_started_ends(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(running, "_stopped", threading.Event())
    with a_command_with_children(tmp_path) as words, ThreadPoolExecutor() as pool:
        status = pool.submit(running.run, "log", *words, check=False)
        wait_for(tmp_path / "begun")
        running.stop_all()
        assert status.result() < 0
    with pytest.raises(running.SetupError, match="Interrupted"):
        running.run("log", "true")


def test_commands_end_with_the_program_that_is_killed(tmp_path: Path) -> None:
    with a_command_with_children(tmp_path) as words:
        script = (
            "from pathlib import Path\n"
            "from build_tools import paths, running\n"
            f"paths.LOGS = Path({str(tmp_path)!r})\n"
            f"running.run('log', *{words})"
        )
        environment = {**os.environ, "PYTHONPATH": str(ROOT / "native")}
        program = subprocess.Popen([sys.executable, "-c", script], env=environment)
        wait_for(tmp_path / "begun")
        program.kill()
        program.wait()


def test_a_command_that_is_not_there_is_named() -> None:
    with pytest.raises(running.SetupError, match="no-such-program"):
        running.run("log", "no-such-program")


def test_the_digest_follows_names_and_contents(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(paths, "ROOT", tmp_path)
    folder = tmp_path / "sources"
    folder.mkdir()
    seen = set()
    for name, text in (("a", "1"), ("a", "2"), ("b", "2")):
        (folder / name).write_text(text)
        seen.add(running.digest("key", folder))
    before = running.digest("key", folder)
    (folder / "__pycache__").mkdir()
    (folder / "__pycache__" / "a.pyc").write_text("")
    assert running.digest("key", folder) == before
    assert len(seen) == 3


def test_what_is_missing_is_named_where_nothing_can_install_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(system, "is_present", lambda evidence: False)
    monkeypatch.setattr(shutil, "which", lambda name, path=None: None)
    with pytest.raises(running.SetupError, match=r"g\+\+.*libnanoflann-dev") as caught:
        system.set_up_system(["build"])
    assert "cmake" not in str(caught.value)  # which pip can bring


def test_every_blender_has_a_python_that_can_be_had() -> None:
    for platform in targets.PLATFORMS.values():
        assert set(python_environment.BLENDERS.values()) <= set(platform.pythons)
    assert python_environment.BLENDERS[python_environment.MAIN_BLENDER] == "3.11"
    wanted = tomllib.loads((ROOT / "pyproject.toml").read_text())["dependency-groups"]["blender"]
    assert wanted == [f"bpy=={python_environment.MAIN_BLENDER}.*"]


def test_java_trusts_whom_the_system_trusts(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    certificate = bytes(range(200))
    known = tmp_path / "known.crt"
    known.write_text("Comment\n" + 2 * ssl.DER_cert_to_PEM_cert(certificate))
    monkeypatch.setenv("SSL_CERT_FILE", str(known))
    monkeypatch.setenv("MAVEN_OPTS", "-Dmine=1")
    options = python_environment._trusting(tmp_path / "store")
    assert f"trustStore={tmp_path / 'store'} " in options
    assert options.endswith(" -Dmine=1")
    store = (tmp_path / "store").read_bytes()
    assert store[:12] == b"\xfe\xed\xfe\xed\0\0\0\2\0\0\0\2"
    assert store.count(certificate) == 2
    known = Path("/etc/ssl/certs/ca-certificates.crt")
    if (keytool := shutil.which("keytool")) and known.is_file():
        monkeypatch.setenv("SSL_CERT_FILE", str(known))
        python_environment._trusting(tmp_path / "store")
        words = [keytool, "-list", "-keystore", tmp_path / "store", "-storepass", "changeit"]
        done = subprocess.run(words, capture_output=True, text=True, check=False)
        count = known.read_text().count("BEGIN CERTIFICATE")
        assert f"contains {count} entries" in done.stdout


def test_what_suites_need_is_fetched_while_the_library_is_built(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    together = threading.Barrier(3, timeout=20)
    groups: list[str] = []

    def fails() -> None:
        together.wait()
        raise running.SetupError("no network")

    known = {
        "a": suites.Suite(Outcome, ("cpython",), together.wait),
        "b": suites.Suite(Outcome, ("two",), fails),
    }
    compiling = threading.Event()

    def compiles() -> None:
        compiling.set()
        together.wait()

    def installs(names: list[str]) -> list[str]:
        assert compiling.is_set() == (names != ["build"])
        groups.extend(names)
        return []

    monkeypatch.setattr(suites, "SUITES", known)
    monkeypatch.setattr(wheels, "refuse_missing", lambda names: None)
    monkeypatch.setattr(wheels, "set_up_building", lambda extra: None)
    monkeypatch.setattr(wheels, "build_wheel", compiles)
    monkeypatch.setattr(wheels, "set_up_system", installs)
    monkeypatch.setattr(wheels, "set_up_python", lambda: compiling.wait(20))
    monkeypatch.setattr(suites, "set_up_wheels", lambda: groups.append("wheels"))
    [error] = suites.set_up_tests(known)
    assert "no network" in str(error)
    assert groups == ["build", "bpy", "cpython", "two", "wheels"]


def test_windows_are_skipped_in_words_where_there_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(suites, "BLENDER", None)
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    [reason] = suites.window().skips
    assert "root" in reason
    assert "POINTMORPH_BLENDER" in reason


def test_two_blenders_are_fetched_side_by_side(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    together = threading.Barrier(2, timeout=20)

    def install(environment: python_environment.Environment, *what: str | Path) -> None:
        target = next(word for word in what if isinstance(word, Path))
        target.mkdir(parents=True)
        (target / "version").write_text(str(what[-1]))
        together.wait()

    monkeypatch.setattr(python_environment.Environment, "pip_install", install)
    versions = ["4.2", "4.5"]
    with ThreadPoolExecutor() as pool:
        list(pool.map(python_environment.set_up_bpy, versions))
    for version in versions:
        assert (tmp_path / "bpy" / version / "version").read_text() == f"bpy=={version}.*"


def is_running(word: str) -> bool:
    """Whether any process was started with this word."""
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        with contextlib.suppress(OSError):
            if word in path.read_text().split("\0"):
                return True
    return False


def test_another_debian_is_made_where_the_first_cannot_be(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def make(suite: str) -> None:
        if suite != "trixie":
            raise running.SetupError(f"{suite} is broken")

    monkeypatch.setattr(other_debian, "set_up", make)
    assert other_debian.set_up_first(["trixie", "sid"]) == "trixie"
    assert capsys.readouterr().out == ""
    assert other_debian.set_up_first(["sid", "trixie"]) == "trixie"
    assert "sid is broken" in capsys.readouterr().out
    with pytest.raises(running.SetupError):
        other_debian.set_up_first(["sid"])


def test_what_makes_a_debian_ends_with_the_one_who_asked(tmp_path: Path) -> None:
    if reason := other_debian.why_not():
        pytest.skip(reason)
    begun, word = tmp_path / "begun", f"{tmp_path.name}.{os.getpid()}"
    words = [*other_debian._namespace(), "sh", "-c", f"touch {begun}; sleep 600; :", word]
    script = f"import subprocess; subprocess.run({words})"
    asking = subprocess.Popen([sys.executable, "-c", script])
    wait_for(begun)
    assert is_running(word)
    asking.kill()
    asking.wait()
    end = time.monotonic() + 60
    while is_running(word):
        assert time.monotonic() < end
        time.sleep(0.01)


def test_a_debian_that_was_left_half_made_is_made_anew(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("POINTMORPH_DEBIAN", str(tmp_path))
    (tmp_path / "sid.unfinished-old" / "usr").mkdir(parents=True)
    (tmp_path / "sid" / "usr").mkdir(parents=True)  # without a stamp
    works, python = False, targets.LINUX.pythons[-1]

    def bootstrap(log: str, *words: str) -> None:
        folder = next(Path(word) for word in words if "unfinished" in word)
        assert list(folder.iterdir()) == []
        (folder / "usr" / "bin").mkdir(parents=True)
        (folder / "usr" / "bin" / f"python{python}").touch()
        if not works:
            raise running.SetupError("no network")

    monkeypatch.setattr(other_debian, "run", bootstrap)
    with pytest.raises(running.SetupError):
        other_debian.set_up("sid")
    assert not (tmp_path / "sid").exists()
    works = True
    root = other_debian.set_up("sid")
    assert [path.name for path in root.iterdir()] == ["usr"]
    assert list(tmp_path.glob("*unfinished*")) == []
    works = False
    assert other_debian.set_up("sid") == root  # nothing is made again
    works, python = True, "4.0"
    for _ in range(2):
        with pytest.raises(running.SetupError, match="no wheel"):
            other_debian.set_up("trixie")


def test_mounts_end_with_the_command(tmp_path: Path) -> None:
    if reason := other_debian.why_not():
        pytest.skip(reason)
    script = f"mount -t tmpfs tmpfs {tmp_path} && touch {tmp_path}/inside && ls {tmp_path}"
    words = [*other_debian._namespace(), "sh", "-c", script]
    assert subprocess.run(words, check=True, capture_output=True).stdout == b"inside\n"
    assert list(tmp_path.iterdir()) == []
    assert str(tmp_path) not in Path("/proc/mounts").read_text()


def test_evidence() -> None:
    assert system.is_present("program:sh")
    assert system.is_present("library:libc.so.6")
    assert system.is_present("module:venv")
    assert system.is_present(f"file:{ROOT}")
    for kind in ("program", "library", "module", "file"):
        assert not system.is_present(f"{kind}:surely_absent")


def test_editing_insists_on_one_match(tmp_path: Path) -> None:
    path = tmp_path / "manifest"
    path.write_text('version = "0"\nname = "x"\n')
    packaging.edit(path, r'^version = ".*"$', 'version = "1.2.0"')
    assert path.read_text() == 'version = "1.2.0"\nname = "x"\n'
    with pytest.raises(running.SetupError, match="wheels"):
        packaging.edit(path, r"^wheels = .*$", "wheels = []")


@pytest.mark.parametrize("arguments", [["nothing"], ["test", "--only", "nothing"], []])
def test_a_wrong_call_ends_with_2(arguments: list[str]) -> None:
    command = [sys.executable, str(ROOT / "build_addon.py"), *arguments]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    assert done.returncode == 2
    assert "usage" in done.stderr


def test_platforms_are_chosen(entry: ModuleType) -> None:
    assert entry.arguments_of(["package"]).platform == "linux"
    assert entry.arguments_of(["package", "--platform", "macos"]).platform == "macos"
    assert entry.arguments_of(["package", "--all"]).all
    assert entry.arguments_of(["test"]).suites == list(suites.SUITES)
    words = ["test", "--platform", "windows"]
    assert entry.arguments_of(words).suites == list(windows.SUITES)
    assert entry.arguments_of([*words, "--only", "windows-cpp"]).suites == ["windows-cpp"]
    for wrong in (["package", "--all", "--platform", "macos"], [*words, "--only", "cpp"]):
        with pytest.raises(SystemExit):
            entry.arguments_of(wrong)


def test_continuous_integration_runs_the_same_command() -> None:
    assert "python3 build_addon.py test" in (ROOT / ".ci" / "run").read_text()


def test_what_tests_alone_need_is_set_up_on_request(
    entry: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[str] = []
    monkeypatch.setattr(wheels, "set_up", lambda: made.append("commands"))
    monkeypatch.setattr(suites, "set_up_tests", lambda names: made.extend(names) or [])
    monkeypatch.setattr(sys, "argv", ["build_addon.py", "setup"])
    assert entry.main() == 0
    assert made == ["commands"]
    monkeypatch.setattr(sys, "argv", ["build_addon.py", "setup", "--tests"])
    assert entry.main() == 0
    assert made[1:] == list(suites.SUITES)


def test_the_comparison_gets_the_pair_and_its_options(
    entry: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown: list[str] = []
    monkeypatch.setattr(wheels, "set_up", lambda: None)
    monkeypatch.setattr(python_environment, "set_up_peers", lambda: None)
    monkeypatch.setattr(entry, "show", lambda *command: shown.extend(map(str, command)) or 0)
    words = ["a.ply", "b.obj", "marks.json", "--points", "3000"]
    monkeypatch.setattr(sys, "argv", ["build_addon.py", "bench", "--peers", *words])
    assert entry.main() == 0
    assert shown[1].endswith("compare_peers.py")
    assert shown[2:6] == ["a.ply", "b.obj", "--features", "marks.json"]
    assert shown[-2:] == ["--points", "3000"]

    monkeypatch.setattr(sys, "argv", ["build_addon.py", "bench", "--peers", "a.ply"])
    with pytest.raises(SystemExit) as end:
        entry.main()
    assert end.value.code == 2
