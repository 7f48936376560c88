"""Building pynusmv and the NuSMV executable from their pinned source.

Everything that turns the sdist `pynusmv==1.0rc8` (2017, with NuSMV 2.5.4, CUDD and MiniSat inside) into one wheel for
today's CPython and today's gcc. The sdist's own setup.py is not used for building: it ignores the exit status of make,
compiles without optimisation and links archives in the order of a directory listing. Standard library only, because this
runs before anything is installed:

    python3 smv_planner/nusmv_build.py --out DIR     # build, or take from the cache, and copy to DIR
    python3 smv_planner/nusmv_build.py --missing     # name the Debian packages that this machine lacks

The wheel holds the packages `pynusmv` and `pynusmv_lower_interface` and the program `NuSMV`, all of one build tree. It is kept
in ${XDG_CACHE_HOME:-~/.cache}/smv_planner/wheels/<python>-<platform>-<libc>-<hash of this file>/ together with its build log.
"""

from __future__ import annotations

import argparse
import base64
import fcntl
import hashlib
import os
import platform
import re
import shlex
import shutil
import signal
import subprocess
import sys
import sysconfig
import tarfile
import tempfile
import time
import zipfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import BinaryIO

NAME, VERSION = "pynusmv", "1.0rc8"
SDIST_SHA256 = "35af7cdd25dfc8dc357770f0764b2cb726aed219200bba2e58c25318b2425aa1"

# What the build installs into an environment of its own. setuptools 81 and later cannot read the sdist's metadata, which
# `pip download` insists on; swig writes the C side of the Python modules; the wheel needs pyparsing when it is tried out.
BUILD_PACKAGES = ("setuptools==80.10.2", "swig==4.5.1", "pyparsing<4")

# Command -> Debian package.
COMMANDS = {"gcc": "gcc", "g++": "g++", "make": "make", "ar": "binutils", "patch": "patch", "flex": "flex", "bison": "bison"}

# gnu17 and -fpermissive: this C is older than what gcc 14 and 15 accept by default. No strict aliasing: nor does it keep to that.
C_FLAGS = "-O2 -fPIC -std=gnu17 -fpermissive -fno-strict-aliasing -w"


@dataclass(frozen=True, slots=True)
class Edit:
    """A text that occurs once in the file at `path`, and what replaces it."""

    path: str
    old: str
    new: str


SDIST_EDITS = (
    # C++11 reads "C"void as a user-defined literal.
    Edit("dependencies/MiniSat/nusmv.patch", 'extern "C"void', 'extern "C" void'),
    # The abstract classes left `collections` in Python 3.10.
    Edit("pynusmv/collections.py", "from collections import Iterator", "from collections.abc import Iterator"),
    Edit("pynusmv/be/encoder.py", "from collections            import Iterator", "from collections.abc import Iterator"),
    # Python 2 names, which swig 4.5 no longer translates.
    Edit("pynusmv_lower_interface/nusmv/compile/compile.i", "PyInt_FromLong", "PyLong_FromLong"),
    Edit("pynusmv_lower_interface/nusmv/dd/dd.i", "PyInt_FromLong", "PyLong_FromLong"),
    Edit("pynusmv_lower_interface/nusmv/parser/parser.i", "PyInt_FromLong", "PyLong_FromLong"),
    Edit("pynusmv_lower_interface/nusmv/sat/sat.i", "PyInt_FromLong", "PyLong_FromLong"),
    Edit("pynusmv_lower_interface/nusmv/sat/sat.i", "PyInt_AsLong", "PyLong_AsLong"),
    Edit("pynusmv_lower_interface/nusmv/utils/utils.i", "PyInt_FromLong", "PyLong_FromLong"),
)
CUDD_EDITS = (
    # glibc dropped `union wait`.
    Edit("util/pipefork.c", "union wait status;", "int status;"),
)

SMOKE_TEST = '''
import importlib, pkgutil, pynusmv_lower_interface.nusmv as nusmv
for module in pkgutil.walk_packages(nusmv.__path__, "pynusmv_lower_interface.nusmv."):
    if "loaders" not in module.name:  # reads XML traces, which needs expat
        importlib.import_module(module.name)
import pynusmv, pynusmv.bmc.glob, pynusmv.bmc.ltlspec, pynusmv.bmc.utils
from pynusmv.prop import propTypes
from pynusmv_lower_interface.nusmv.cinit import cinit
from pynusmv_lower_interface.nusmv.prop.prop import Prop_get_trace
from pynusmv_lower_interface.nusmv.trace import trace as traces
with pynusmv.init.init_nusmv():
    cinit.set_nusmv_stdout("/dev/null")
    pynusmv.glob.load("""MODULE main
VAR x : 0..3;
ASSIGN init(x) := 0; next(x) := case x < 3 : x + 1; TRUE : 3; esac;
LTLSPEC !(F x = 3)
""")
    pynusmv.bmc.glob.go_bmc()
    question = next(p for p in pynusmv.glob.prop_database() if p.type == propTypes["LTL"])
    pynusmv.bmc.ltlspec.check_ltl_incrementally(question, 5, pynusmv.bmc.utils.no_loopback())
    manager = traces.TraceManager_get_trace_at_index
    found = pynusmv.trace.Trace(manager(traces.TracePkg_get_global_trace_manager(), Prop_get_trace(question._ptr) - 1))
    assert len(found) == 3, len(found)
'''
SMOKE_MODEL = "MODULE main\nVAR x : boolean;\nASSIGN init(x) := FALSE; next(x) := !x;\nINVARSPEC !x\n"
SMOKE_ANSWER = b"-- invariant !x  is false"


class BuildError(Exception):
    """The wheel could not be built; the text says which step failed and how."""


# ---------------------------------------------------------------------------------------------------------- the recipe


def build(work: Path, jobs: int, run: Run) -> Path:
    """Build the wheel somewhere below `work` and test it."""
    run.step("preparing tools (swig) in a build environment")
    tools = work / "tools"
    run(sys.executable, "-I", "-m", "venv", tools)
    pip = (tools / "bin/python", "-m", "pip", "--quiet", "--disable-pip-version-check")
    run(*pip, "install", *BUILD_PACKAGES)

    run.step(f"getting {NAME} {VERSION}")
    source = unpack_tar(download(work / "sdist", pip, run), work)
    apply_edits(source, SDIST_EDITS)

    run.step("compiling MiniSat")
    minisat = build_minisat(source / "dependencies/MiniSat", jobs, run)
    run.step("configuring NuSMV and compiling CUDD")
    nusmv = prepare_nusmv(source / "dependencies/NuSMV", minisat, jobs, run)
    run.step("compiling NuSMV, about a minute")
    run("make", f"-j{jobs}", cwd=nusmv, may_fail=True)  # a race between bison and its users, if any, is mended by the next line
    run("make", cwd=nusmv)

    run.step("compiling the Python modules, about a minute")
    build_modules(source, nusmv, minisat, jobs, tools / "bin/swig", run)

    run.step("packing and testing the wheel")
    run("strip", nusmv / "NuSMV")
    wheel = write_wheel(source, nusmv, work)
    shutil.rmtree(source)  # what was built must work without the tree it was built in
    run(*pip, "install", "--no-deps", "--no-index", wheel)
    run(tools / "bin/python", "-c", SMOKE_TEST, cwd=work, timeout=120)
    (work / "smoke.smv").write_text(SMOKE_MODEL)
    if SMOKE_ANSWER not in run(tools / "bin/NuSMV", work / "smoke.smv", cwd=work, timeout=120):
        raise BuildError("NuSMV was built but does not answer a question with a known answer")
    return wheel


def download(folder: Path, pip: Sequence[str | Path], run: Run) -> Path:
    """The sdist, refused by pip (before anything of it runs) and by us unless it is the pinned one."""
    folder.mkdir()
    pin = folder / "pin.txt"
    pin.write_text(f"{NAME}=={VERSION} --hash=sha256:{SDIST_SHA256}\n")
    run(*pip, "download", "--no-deps", "--no-binary", NAME, "--no-build-isolation", "--require-hashes", "-d", folder, "-r", pin)
    (sdist,) = folder.glob("*.tar.gz")
    if hashlib.sha256(sdist.read_bytes()).hexdigest() != SDIST_SHA256:
        raise BuildError(f"{sdist.name} is not the file we know: its sha256 differs from {SDIST_SHA256}")
    return sdist


def build_minisat(folder: Path, jobs: int, run: Run) -> Path:
    with zipfile.ZipFile(folder / "minisat2-070721.zip") as archive:
        archive.extractall(folder)
    for patch in ("nusmv.patch", "pynusmv.patch", "makefiles.patch"):
        run("patch", "-p0", "-N", "-i", patch, cwd=folder)
    run("make", f"-j{jobs}", cwd=folder / "minisat")
    return folder / "minisat"


def prepare_nusmv(folder: Path, minisat: Path, jobs: int, run: Run) -> Path:
    """NuSMV configured, with CUDD compiled beside it. Never with zchaff, which downloads."""
    top = unpack_tar(folder / "NuSMV-2.5.4.tar.gz", folder)
    for patch in ("pynusmv.patch", "cudd.patch"):
        run("patch", "-p0", "-N", "-i", patch, cwd=folder)
    cudd, nusmv = top / "cudd-2.4.1.1", top / "nusmv"
    apply_edits(cudd, CUDD_EDITS)
    run("make", f"-j{jobs}", "-f", "Makefile_64bit", "CC=gcc", f"ICFLAGS={C_FLAGS}", cwd=cudd)
    for library in ("cudd", "cudd_util", "mtr", "st"):  # CUDD's make succeeds even if a folder of it failed
        if not (cudd / f"lib/lib{library}.a").exists():
            raise BuildError(f"CUDD was compiled without its part lib{library}.a")
    run(
        "./configure",
        *("--enable-minisat", f"--with-minisat-libdir={minisat}", f"--with-minisat-incdir={minisat}", "--with-pic"),
        *("--disable-zchaff", "--disable-readline", "--disable-expat", "--disable-dependency-tracking"),
        *("CC=gcc", "CXX=g++", f"CFLAGS={C_FLAGS}", "CXXFLAGS=-O2 -fPIC"),
        cwd=nusmv,
    )
    return nusmv


def build_modules(source: Path, nusmv: Path, minisat: Path, jobs: int, swig: Path, run: Run) -> None:
    """One library with all of NuSMV, and the swig modules that share it. Make runs them side by side."""
    lower = Path("pynusmv_lower_interface")
    interfaces = sorted(re.findall(r"'(pynusmv_lower_interface/[\w/]+)\.i'", (source / "setup.py").read_text()))
    if len(interfaces) != 58:
        raise BuildError(f"setup.py lists {len(interfaces)} modules, not 58")

    cudd = nusmv.parent / "cudd-2.4.1.1"
    objects = sorted(path for path in nusmv.rglob("*.o") if path.name != "main.o")
    archives = [*sorted((cudd / "lib").glob("*.a")), minisat / "libMiniSat.a"]
    library = lower / "libdependencies.so"
    listing = source / "objects.txt"
    listing.write_text("\n".join([*map(str, objects), "-Wl,--start-group", *map(str, archives), "-Wl,--end-group"]))
    run("g++", "-shared", "-s", "-Wl,-z,defs", "-o", library, f"@{listing}", cwd=source)

    headers = " ".join(f"-I{folder}" for folder in (nusmv, nusmv / "src", cudd / "include"))
    python_headers = f"-I{sysconfig.get_path('include')} -I{sysconfig.get_path('platinclude')}"
    suffix = sysconfig.get_config_var("EXT_SUFFIX")
    rules, modules = [], []
    for interface in interfaces:
        folder, name = os.path.split(interface)
        module, wrapper = f"{folder}/_{name}{suffix}", f"{folder}/{name}_wrap.c"
        own_code = f"{interface}.c" if (source / f"{interface}.c").exists() else ""
        up = os.path.relpath(lower, folder)
        modules.append(module)
        rules.append(
            f"{module}: {interface}.i\n"
            f"\t{swig} -python {headers} -o {wrapper} {interface}.i\n"
            f"\tgcc {C_FLAGS} -DNDEBUG {headers} {python_headers} -shared -s -o $@ {wrapper} {own_code}"
            f" -L{lower} -ldependencies '-Wl,-rpath,$$ORIGIN/{up}'\n"
        )
    (source / "modules.mk").write_text("\n".join([f"all: {' '.join(modules)}", *rules]))
    run("make", f"-j{jobs}", "-f", "modules.mk", cwd=source)

    for folder, _, _ in os.walk(source / lower):
        Path(folder, "__init__.py").touch()


# ------------------------------------------------------------------------------------------------------------ the wheel


def write_wheel(source: Path, nusmv: Path, folder: Path) -> Path:
    """The two packages, the NuSMV program (pip puts it beside the interpreter) and the licences."""
    info = f"{NAME}-{VERSION}.dist-info"
    content: dict[str, bytes] = {}
    for package in ("pynusmv", "pynusmv_lower_interface"):
        for path in sorted((source / package).rglob("*")):
            if path.suffix in (".py", ".so"):
                content[str(path.relative_to(source))] = path.read_bytes()
    program = f"{NAME}-{VERSION}.data/scripts/NuSMV"
    content[program] = (nusmv / "NuSMV").read_bytes()
    content[f"{info}/licenses/NuSMV-LGPL-2.1"] = (nusmv / "LGPL-2.1").read_bytes()
    content[f"{info}/licenses/CUDD"] = (nusmv.parent / "cudd-2.4.1.1/LICENSE").read_bytes()
    content[f"{info}/licenses/MiniSat"] = (source / "dependencies/MiniSat/minisat/LICENSE").read_bytes()
    content[f"{info}/METADATA"] = (
        f"Metadata-Version: 2.1\nName: {NAME}\nVersion: {VERSION}\nSummary: Embed NuSMV as a python library\n"
        "License: LGPL-3.0-or-later AND LGPL-2.1-or-later AND MIT AND BSD-3-Clause\nRequires-Dist: pyparsing<4\n\n"
        f"Built from the sdist with sha256 {SDIST_SHA256}, with these texts replaced:\n\n"
        + "".join(f"    {edit.path}: {edit.old} -> {edit.new}\n" for edit in (*SDIST_EDITS, *CUDD_EDITS))
    ).encode()
    content[f"{info}/WHEEL"] = (
        f"Wheel-Version: 1.0\nGenerator: smv_planner.nusmv_build\nRoot-Is-Purelib: false\nTag: {wheel_tag()}\n".encode()
    )
    record = "".join(
        f"{name},sha256={base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b'=').decode()},{len(data)}\n"
        for name, data in content.items()
    )
    content[f"{info}/RECORD"] = f"{record}{info}/RECORD,,\n".encode()

    wheel = folder / wheel_name()
    with zipfile.ZipFile(wheel, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in content.items():
            entry = zipfile.ZipInfo(name)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = (0o100755 if name == program or name.endswith(".so") else 0o100644) << 16
            archive.writestr(entry, data)
    return wheel


def wheel_name() -> str:
    return f"{NAME}-{VERSION}-{wheel_tag()}.whl"


def wheel_tag() -> str:
    return f"{python_tag()}-{python_tag()}-{re.sub('[-.]', '_', sysconfig.get_platform())}"


def python_tag() -> str:
    return f"cp{sys.version_info.major}{sys.version_info.minor}{sys.abiflags}"


# ------------------------------------------------------------------------------------------------------------ the cache


def cache_place() -> Path:
    """The folder of this recipe's wheel for this Python on this system; it exists once the wheel is built."""
    libc = "".join(platform.libc_ver())
    recipe = hashlib.sha256(Path(__file__).read_bytes()).hexdigest()[:16]
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return cache / "smv_planner/wheels" / f"{python_tag()}-{sysconfig.get_platform()}-{libc}-{recipe}"


def cached_wheel(jobs: int) -> Path:
    """From the cache, or built into it."""
    place = cache_place()
    if place.exists():
        say(f"pynusmv and NuSMV are in the cache: {place}")
        return place / wheel_name()
    place.parent.mkdir(parents=True, exist_ok=True)
    with locked(place.parent) as alone:
        if not place.exists():  # nobody built it while we waited
            if alone:
                for abandoned in place.parent.glob(".building-*"):  # by a build that was killed
                    shutil.rmtree(abandoned, ignore_errors=True)
            say(f"building {NAME} {VERSION} and NuSMV for {python_tag()}: once on this machine, some minutes")
            build_into(place, jobs)
    return place / wheel_name()


def build_into(place: Path, jobs: int) -> None:
    """Build beside `place` and rename at the end, so that `place` is whole or absent. Interrupted, nothing stays."""
    failure = place.with_name(f"{place.name}.failed.log")
    work = Path(tempfile.mkdtemp(prefix=".building-", dir=place.parent))
    try:
        done = work / "done"
        done.mkdir()
        with (done / "build.log").open("w+b") as log:
            run = Run(log)
            try:
                build(work, jobs, run).rename(done / wheel_name())
            except BuildError as error:
                shutil.copyfile(log.name, failure)
                last = failure.read_text(errors="replace").splitlines()[-25:]
                raise BuildError("\n".join([*last, "", f"{run.current}: {error}", f"The whole log: {failure}"])) from None
            run.step("done")
        try:
            done.rename(place)
        except OSError:
            if not place.exists():  # else another build, on a file system without locks, was faster: its wheel is as good
                raise
        failure.unlink(missing_ok=True)
    finally:
        with ignored_signals():
            shutil.rmtree(work, ignore_errors=True)


@contextmanager
def locked(folder: Path) -> Iterator[bool]:
    """Wait until no other process builds here. The folder itself is the lock, so no lock file stays behind."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            say("another process is building it: waiting for that one")
            fcntl.flock(handle, fcntl.LOCK_EX)
        except OSError:  # no locks on this file system: both build, both get a whole wheel
            yield False
            return
        yield True
    finally:
        os.close(handle)


# ---------------------------------------------------------------------------------------------------------- the machine


def missing_packages() -> list[str]:
    """Debian packages without which the set-up cannot work, found by what is really not there. No compiler for a cached wheel."""
    version = f"python{sys.version_info.major}.{sys.version_info.minor}"
    missing = []
    if find_spec("venv") is None or find_spec("ensurepip") is None:
        missing.append(f"{version}-venv")
    if not cache_place().exists():
        missing += [package for command, package in COMMANDS.items() if shutil.which(command) is None]
        if not Path(sysconfig.get_path("include"), "Python.h").exists():
            missing.append(f"{version}-dev")
    return missing


class Run:
    """Runs commands of the build, one after the other, everything they print going to the log."""

    def __init__(self, log: BinaryIO) -> None:
        self.log = log
        self.current = ""
        self.began = time.monotonic()
        # Neither the caller's make nor its compiler settings nor its Python path take part in the build.
        unwanted = ("MAKE", "MFLAGS", "CFLAGS", "CXX", "CPP", "CC", "LDFLAGS", "LIBS", "PYTHON", "VIRTUAL_ENV", "PIP_REQUIRE")
        self.environment = {name: value for name, value in os.environ.items() if not name.startswith(unwanted)}
        self.environment["LC_ALL"] = "C"

    def step(self, what: str) -> None:
        self.current = what
        say(f"{time.monotonic() - self.began:4.0f} s  {what}")

    def __call__(self, *command: str | Path, cwd: Path | None = None, may_fail: bool = False, timeout: float = 3600) -> bytes:
        """What the command printed; its children end with it, however this ends."""
        words = [str(word) for word in command]
        self.log.write(f"\n$ {shlex.join(words)}\n".encode())
        self.log.flush()
        start = self.log.tell()
        process = subprocess.Popen(
            words,
            cwd=cwd,
            env=self.environment,
            stdin=subprocess.DEVNULL,
            stdout=self.log,
            stderr=subprocess.STDOUT,
            start_new_session=True,  # so that its children can be ended with it
        )
        try:
            status = process.wait(timeout)
        except subprocess.TimeoutExpired:
            raise BuildError(f"{words[0]} did not end within {timeout:.0f} s") from None
        finally:
            if process.returncode is None:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()
        if status != 0 and not may_fail:
            raise BuildError(f"{words[0]} ended with exit status {status}")
        self.log.seek(start)
        return self.log.read()


def apply_edits(folder: Path, edits: Sequence[Edit]) -> None:
    for edit in edits:
        path = folder / edit.path
        text, old = path.read_bytes(), edit.old.encode()
        if text.count(old) != 1:
            raise BuildError(f"{edit.path} should contain {edit.old!r} once, but does so {text.count(old)} times")
        path.write_bytes(text.replace(old, edit.new.encode()))


def unpack_tar(archive: Path, folder: Path) -> Path:
    """The one folder that the archive holds."""
    with tarfile.open(archive) as tar:
        tar.extraction_filter = getattr(tarfile, "data_filter", lambda member, _: member)
        tar.extractall(folder)
        return folder / tar.getnames()[0].split("/")[0]


@contextmanager
def ignored_signals() -> Iterator[None]:
    before = {number: signal.signal(number, signal.SIG_IGN) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def interrupt(number: int, _: object) -> None:
    raise KeyboardInterrupt(number)


def say(text: str) -> None:
    print(f"nusmv_build: {text}", file=sys.stderr, flush=True)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description="Build the pynusmv wheel with its NuSMV program, or take it from the cache.")
    parser.add_argument("--out", type=Path, metavar="DIR", help="copy the wheel to this folder")
    parser.add_argument("--jobs", type=int, default=len(os.sched_getaffinity(0)), metavar="N", help="compilers at once")
    parser.add_argument("--missing", action="store_true", help="only name the Debian packages that this machine lacks")
    options = parser.parse_args(arguments)
    missing = missing_packages()
    if options.missing:
        print(*missing)
        return 0
    if missing:
        say(f"not on this machine: {' '.join(missing)} (Debian package names)")
        return 1

    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, interrupt)
    try:
        wheel = cached_wheel(options.jobs)
        if options.out is not None:
            options.out.mkdir(parents=True, exist_ok=True)
            copy = options.out / f".{wheel.name}.{os.getpid()}"
            shutil.copyfile(wheel, copy)
            wheel = copy.replace(options.out / wheel.name)
    except BuildError as error:
        say(f"FAILED\n{error}")
        return 1
    except OSError as error:  # a full disk, or a home folder that cannot be written: XDG_CACHE_HOME may name another
        say(f"FAILED: {error}")
        return 1
    except KeyboardInterrupt:
        say("interrupted; nothing is left behind")
        return 130
    print(wheel)
    return 0


if __name__ == "__main__":
    sys.exit(main())
