"""Where compiled kernels are kept, that they are found again, and that a stale one is not."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numba
import pytest

import ins
from alignment.motion import disturbed_epochs_kernel
from ins import jit
from ins.strapdown import kernel as strapdown_kernel

PACKAGES = ("ins", "trajectories", "alignment", "infield", "simreal", "recal")
FORKS = """
import json, os, sys, tempfile
import numba, platformdirs  # what every probe needs and no cache depends on
for line in sys.stdin:
    request = json.loads(line)
    sys.stdout.flush()
    child = os.fork()
    if child == 0:
        os.environ.clear()
        os.environ.update(request["environment"])
        os.chdir(request["site"])
        sys.path.insert(0, request["site"])
        tempfile.tempdir = None
        exec(request["code"])
        sys.stdout.flush()
        os._exit(0)
    assert os.waitpid(child, 0)[1] == 0
"""
PROBE = """
import json
from pathlib import Path
from ins import jit
from ins.strapdown import kernel as strapdown_kernel
g = strapdown_kernel.gravity(0.0, 0.0)
hits = sum(strapdown_kernel.gravity.stats.cache_hits.values())
folder = jit.cache_folder(Path(strapdown_kernel.__file__).parent)
print(json.dumps({"g": g, "hits": hits, "folder": str(folder)}))
"""


@pytest.fixture
def copy(tmp_path):
    """A copy of the package that owes nothing to this machine's caches."""
    shutil.copytree(
        Path(ins.__file__).parent,
        tmp_path / "site/ins",
        ignore=shutil.ignore_patterns("__pycache__"),
    )
    return tmp_path / "site"


@pytest.fixture(scope="module")
def forks():
    """A process that has loaded numba, and nothing of this package, and forks one for each probe:
    to load numba takes longer than to compile the kernel.
    """
    clean = {
        k: v
        for k, v in os.environ.items()
        if k not in ("NUMBA_CACHE_DIR", "NUMBA_DISABLE_JIT", "PYTHONPATH")
    }
    with subprocess.Popen(
        [sys.executable, "-B", "-c", FORKS],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=clean,
        cwd="/",
    ) as process:

        def ask(site, **environment):
            """What the kernel says in a process of its own that imports the package from `site`."""
            request = {"site": str(site), "environment": {**clean, **environment}, "code": PROBE}
            process.stdin.write(json.dumps(request) + "\n")
            process.stdin.flush()
            return json.loads(process.stdout.readline())

        yield ask


def test_the_second_process_compiles_nothing_and_a_changed_constant_is_seen(forks, copy, tmp_path):
    first, second = (forks(copy, NUMBA_CACHE_DIR=str(tmp_path / "cache")) for _ in range(2))
    assert (first["hits"], second["hits"]) == (0, 1)
    assert Path(first["folder"]).is_relative_to(tmp_path / "cache")
    source = copy / "ins/earth.py"
    text = source.read_text()
    assert text.count("9.7803253359") == 1
    source.write_text(text.replace("9.7803253359", "9.7903253359"))
    third = forks(copy, NUMBA_CACHE_DIR=str(tmp_path / "cache"))
    assert third["hits"] == 0
    assert third["g"] - second["g"] == pytest.approx(0.01, abs=1e-9)


def test_the_first_place_that_can_be_written_is_taken(forks, copy, tmp_path):
    """A file where a folder is wanted stops root too."""
    wall = tmp_path / "wall"
    wall.write_text("")
    (tmp_path / "tmp").mkdir()
    shut = {
        "XDG_CACHE_HOME": f"{wall}/c",
        "HOME": f"{wall}/h",
        "LOCALAPPDATA": f"{wall}/l",
        "TMPDIR": str(tmp_path / "tmp"),
    }
    seen = forks(copy, **{**shut, "XDG_CACHE_HOME": str(tmp_path / "user")})
    if sys.platform == "linux":
        assert Path(seen["folder"]).parent == tmp_path / "user/recal"
        beside = forks(copy, **shut)
        assert Path(beside["folder"]).parent == copy / "ins/__pycache__"
        shutil.rmtree(copy / "ins/__pycache__")
    (copy / "ins/__pycache__").write_text("")
    first, second = (forks(copy, **shut) for _ in range(2))
    assert Path(first["folder"]).parent == tmp_path / "tmp" / f"recal-{os.getuid()}"
    assert (first["hits"], second["hits"]) == (0, 1)
    Path(first["folder"]).parent.chmod(0o777)  # others could have put code there
    nowhere = forks(copy, **shut)
    assert (nowhere["folder"], nowhere["hits"], nowhere["g"]) == ("None", 0, first["g"])


@pytest.fixture
def package(tmp_path):
    """A top-level package with constants at its top and two inner packages, one with the kernel."""
    for folder in ("own", "own/motion", "own/motion/deep", "own/other"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "__init__.py").write_text("")
    (tmp_path / "own/constants.py").write_text("G = 9.8")
    (tmp_path / "own/other/constants.py").write_text("G = 9.8")
    return tmp_path / "own"


@pytest.mark.parametrize(
    "changed", ["constants.py", "other/constants.py", "motion/deep/__init__.py", "new.py"]
)
@pytest.mark.parametrize("kernel_folder", ["motion", "motion/deep", "."])
def test_every_source_of_the_kernels_top_package_is_in_the_name(
    package, kernel_folder, changed, monkeypatch, tmp_path
):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))

    def name():
        return jit.cache_folder.__wrapped__(package / kernel_folder).name

    before = name()
    assert jit.top_package(package / kernel_folder) == package
    (package / changed).write_text("G = 9.9")
    assert name() != before


def test_the_kernels_of_all_packages_are_named_by_ins_and_their_own_top_package():
    top = Path(ins.__file__).parent
    assert jit.top_package(top / "filters") == jit.top_package(top / "strapdown") == top
    shake = Path(disturbed_epochs_kernel.__file__)
    assert jit.top_package(shake.parent) == top.parent / "alignment"
    name = f"kernels-{jit.source_hash(top, top.parent / 'alignment')}"
    assert Path(disturbed_epochs_kernel.add_rows.stats.cache_path).parent.name == name


def test_kernels_take_nothing_from_a_third_package():
    """A constant of another package could change without a change of the hash."""
    top = Path(ins.__file__).parent.parent
    sources = [path for name in PACKAGES for path in (top / name).rglob("*.py")]
    users = [path for path in sources if "from ins.jit import" in path.read_text("utf-8")]
    assert len(users) >= 5
    for path in users:
        own = path.relative_to(top).parts[0]
        for module in re.findall(r"^\s*from (\w+)", path.read_text("utf-8"), re.MULTILINE):
            assert module in {"ins", own, "math", "numpy", "collections", "typing"}, path


def test_the_users_own_numba_cache_is_left_alone():
    before = numba.config.CACHE_DIR

    @jit.jit
    def one():
        return 1

    assert one() == 1 and numba.config.CACHE_DIR == before


def test_folders_of_old_sources_are_forgotten(tmp_path):
    for k in range(jit.KEPT_FOLDERS + 3):
        folder = tmp_path / f"kernels-{k:016x}"
        folder.mkdir()
        os.utime(folder, (k, k))
    (tmp_path / "others").mkdir()
    jit._remove_old(tmp_path)
    kept = sorted(f.name for f in tmp_path.iterdir())
    assert len(kept) == jit.KEPT_FOLDERS + 1
    assert kept[0] == f"kernels-{3:016x}"
    assert kept[-1] == "others"


def test_without_its_folder_nothing_is_kept_elsewhere(monkeypatch, tmp_path):
    """numba would go on to __pycache__, where nothing says of which sources the code is."""
    assert Path(strapdown_kernel.gravity.stats.cache_path).is_relative_to(
        jit.cache_folder(Path(jit.__file__).parent)
    )
    (tmp_path / "file").write_text("")
    monkeypatch.setattr(jit, "cache_folder", lambda package: tmp_path / "file" / "gone")
    alone = jit.jit(strapdown_kernel.gravity.py_func)
    assert alone(0.5, 10.0) == strapdown_kernel.gravity(0.5, 10.0)
    assert alone.signatures and alone.stats.cache_path is None
