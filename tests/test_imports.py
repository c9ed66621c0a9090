"""What stands beside the tests does nothing when it is imported: pytest imports every module here to
look for examples, on machines that lack what only one script needs.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
HELPERS = sorted(
    path
    for folder in ("fixtures", "tests")
    for path in (ROOT / folder).rglob("*.py")
    if not path.name.startswith(("test_", "__"))
)
# Imports all modules that are named; says what one of them, not a library beneath it, did meanwhile.
_IMPORT_ALL = """
import importlib.util, sys, sysconfig, threading

root, *names = sys.argv[1:]
ours = {f"{root}/{name}": name for name in names}
stdlib, site = sysconfig.get_path("stdlib"), sysconfig.get_path("purelib")
deeds = (
    "os.chdir", "os.fork", "os.mkdir", "os.posix_spawn", "os.putenv", "os.remove", "os.rename", "os.system",
    "shutil.copyfile", "socket.bind", "socket.connect", "subprocess.Popen", "tempfile.mkdtemp", "tempfile.mkstemp",
)

def doer():
    frame = sys._getframe(2)
    while frame is not None:
        file = frame.f_code.co_filename
        if file in ours:
            return f"{ours[file]}:{frame.f_lineno}"
        # What the standard library does is done for its caller; what an import does is not.
        if not file.startswith(stdlib) or file.startswith(site):
            return None
        frame = frame.f_back

def watch(event, args):
    written = event == "open" and isinstance(args[1], str) and set(args[1]) & set("wax+")
    if (written or event in deeds) and (where := doer()):
        print(f"{where}: {event} {args[0]!r}")

sys.path[:0] = [root, f"{root}/tests/benchmarks"]
sys.addaudithook(watch)
before = threading.active_count(), list(sys.argv), list(sys.path)
for name in names:
    spec = importlib.util.spec_from_file_location(name[:-3].replace("/", "."), f"{root}/{name}")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    try:
        spec.loader.exec_module(module)
    except BaseException as error:
        print(f"{name}: {type(error).__name__}: {error}")
    if (threading.active_count(), sys.argv, sys.path) != before:
        print(f"{name}: a thread runs, or sys.argv or sys.path is another")
        sys.argv[:], sys.path[:] = before[1:]
"""


def said_on_import(root: Path, names: list[str]) -> str:
    """What importing these modules in one process says; nothing where they do nothing."""
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", _IMPORT_ALL, str(root), *names],
        cwd=root,
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)},
    )
    return done.stdout + done.stderr


def test_modules_beside_the_tests_do_nothing_on_import() -> None:
    assert HELPERS
    names = [path.relative_to(ROOT).as_posix() for path in HELPERS]
    assert said_on_import(ROOT, names) == ""


def test_a_module_that_does_something_is_named(tmp_path: Path) -> None:
    for name, code in {
        "starts": "import subprocess, sys\nsubprocess.run([sys.executable, '-c', ''])",
        "writes": "from pathlib import Path\nPath('left.txt').write_text('')",
        "speaks": "print('hello')",
        "lacks": "import a_package_that_nobody_has",
        "ends": "import sys\nsys.exit(3)",
        "reads": "import sys\nsys.path.insert(0, '/tmp')",
        "good": "import subprocess, sys\nfrom pathlib import Path\nHERE = Path(__file__)",
    }.items():
        (tmp_path / f"{name}.py").write_text(code)
    names = sorted(path.name for path in tmp_path.glob("*.py"))
    lines = said_on_import(tmp_path, names).splitlines()
    assert [line.split(":")[0] for line in lines] == [
        "ends.py", "lacks.py", "reads.py", "hello", "starts.py", "writes.py",
    ]  # fmt: skip
