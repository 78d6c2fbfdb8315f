"""Machine code from the cache: the same results, no compilation; functions compiled after it was loaded."""

import json
import os
import subprocess
import sys
from pathlib import Path

LOOPS = """
import numpy as np
from scleraforce.compiled import compiled

@compiled
def square(x):
    return x * x

@compiled
def norm(values):
    total = 0.0
    for row in range(values.shape[0]):
        total += square(np.sin(values[row])) / 3.0
    return np.sqrt(total)

@compiled
def late(values):
    doubled = np.empty_like(values)
    for row in range(values.shape[0]):
        doubled[row] = 2.0 * values[row]
    return norm(doubled) + norm(values)
"""
CALL = """
import json, sys
import numpy as np
from loops import late, norm
values = np.linspace(0.1, 2.0, 101)
found = [norm(values).hex()]
if "late" in sys.argv:
    found += [late(values.astype(np.float32)).hex(), float(norm(values.astype(np.float32))).hex()]
imported = [name for name in ("numba.np.arraymath", "numba.np.arrayobj") if name in sys.modules]
print(json.dumps([found, imported]))
"""


def call(folder: Path, *words: str) -> tuple[list[str], list[str], str]:
    environment = {**os.environ, "XDG_CACHE_HOME": str(folder / "cache"), "PYTHONPATH": str(folder)}
    done = subprocess.run([sys.executable, "-c", CALL, *words], env=environment, capture_output=True, check=True)
    found, imported = json.loads(done.stdout)
    return found, imported, done.stderr.decode()


def test_machine_code_is_compiled_once_and_anew_if_its_file_is_broken_or_more_is_needed(tmp_path: Path) -> None:
    (tmp_path / "loops.py").write_text(LOOPS)
    compiled, _, first_notice = call(tmp_path)
    loaded, imported, notice = call(tmp_path)
    assert "compiling, once" in first_notice
    assert loaded == compiled
    assert (notice, imported) == ("", [])  # the compiler's modules are not imported
    after_loading, _, notice = call(tmp_path, "late")
    assert notice.count("compiling, once") == 1
    assert (after_loading, [], "") == call(tmp_path, "late")
    copy = tmp_path / "copy"  # of the same sources, at another place and time
    copy.mkdir()
    (copy / "loops.py").write_text(LOOPS)
    (copy / "cache").symlink_to(tmp_path / "cache")
    assert call(copy, "late") == (after_loading, [], "")
    codes = list((tmp_path / "cache").rglob("*.nbc"))
    assert codes
    for code in codes:
        code.write_bytes(code.read_bytes()[:100])
    assert call(tmp_path)[0] == compiled
