"""Packages, their order and the public API (docs/architecture.md) hold in the code:
imports, purity, the runtime.
"""

import ast
import inspect
import re
import subprocess
import sys
from functools import cache
from graphlib import TopologicalSorter
from importlib import import_module
from math import pi
from pathlib import Path

import pytest
from analytic_frames import recording_toml, write_one_frame
from analytic_library import analytic_library
from faces import definitions, docstring_names, names_behind
from sources import syntax_nodes

import scleraforce
from scleraforce.base.compiled_loops import _deciding
from scleraforce.base.errors import InputError, StudyError
from scleraforce.base.units import SI_PER_UNIT, STANDARD_GRAVITY_M_S2
from scleraforce.lab.training.slice_dataset import open_dataset
from scleraforce.library.library_file import load_library
from scleraforce.library.library_store import open_library
from scleraforce.reading.load_model import (
    load_classifier,
    load_force_reader,
    load_reader,
)
from scleraforce.recordings.formats.image_files import read_frame
from scleraforce.recordings.recording_folder import read_recording
from scleraforce.records.calibration_file import open_calibration, read_calibration
from scleraforce.records.study import parse_study, read_study

ROOT = Path(scleraforce.__file__).parent
# Packages by row, the lowest first (docs/architecture.md).
ROWS = (
    {"base"},
    {"records"},
    {"mechanics", "wall", "recordings"},
    {"library"},
    {"fit"},
    {"reading"},
    {"calibration"},
    {"live", "lab"},
    {"front"},
)
ROW = {package: row for row, packages in enumerate(ROWS) for package in packages}
PURE = ["wall", "mechanics", "fit", "lab.scanner", "calibration", "live.decision"]
IMPURE = {"calibration.evaluation"}  # reads recordings, by worker processes
IMPURE_MODULES = {
    "socket",
    "time",
    "random",
    "subprocess",
    "requests",
    "urllib",
    "logging",
    "asyncio",
    "threading",
}
IMPURE_CALLS = {"print", "open", "input"}
# Methods of paths, NumPy and OpenCV.
FILE_CALLS = {
    "read_text",
    "read_bytes",
    "write_text",
    "write_bytes",
    "open",
    "mkdir",
    "unlink",
    "touch",
    "iterdir",
    "glob",
    "rglob",
    "exists",
    "is_file",
    "is_dir",
    "stat",
    "load",
    "save",
    "savez",
    "savez_compressed",
    "loadtxt",
    "savetxt",
    "genfromtxt",
    "fromfile",
    "tofile",
    "memmap",
    "imread",
    "imwrite",
}
FILE_MODULES = {
    "scleraforce.base.whole_files",
    "scleraforce.base.checked_store",
    "os",
    "shutil",
    "tempfile",
    "tifffile",
    "zarr",
}
COPYLEFT = {
    "felupe",
    "sksparse",
    "pyFAI",
    "PyQt5",
    "PyQt6",
    "gmsh",
    "dolfin",
    "cholespy",
    "Sofa",
}
BIG = {
    "nibabel",
    "nrrd",
    "metaimageio",
    "rosbags",
    "mcap",
    "scipy",
    "skfem",
    "torch",
    "zarr",
    "matplotlib",
    "pydicom",
    "tifffile",
    "tqdm",
    "onnx",
    "pandas",
}
# Modules of the control loop: they need NumPy, OpenCV and ONNX Runtime alone.
RUNTIME = [
    "wall.find_wall",
    "library",
    "records.calibration_file",
    "reading.load_model",
    "reading.answer",
    "live.monitor",
    "live.companions.second_opinion",
    "live.companions.black_box",
    "live.network.operator_reset",
    "live.replay.scanner_player",
]
# Factors between units, other than powers of ten, and their inverses.
FACTORS = {
    words: value
    for name, factor in {
        "mmHg": SI_PER_UNIT["mmhg"][1],
        "degree": pi / 180,
        "gravity": STANDARD_GRAVITY_M_S2,
    }.items()
    for words, value in ((name, factor), (f"1 / {name}", 1 / factor))
}
MODULES = sorted(path for path in ROOT.rglob("*.py"))


def dotted(path: Path) -> str:
    """Return the module's name below `scleraforce` (empty for the package itself)."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(part for part in parts if part != "__init__")


NAMES = {f"scleraforce.{dotted(path)}".rstrip("."): path for path in MODULES}


@cache
def imported(path: Path) -> frozenset[str]:
    """Return every module and name that a file imports, also in functions."""
    names: set[str] = set()
    for node in syntax_nodes(path):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import; write scleraforce..."
            names |= {node.module or ""} | {
                f"{node.module}.{alias.name}" for alias in node.names
            }

    return frozenset(names)


def at_import(path: Path) -> set[str]:
    """Return the modules that a file needs before it can be imported, and names."""
    needed: set[str] = set()
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Import):
            needed |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names = {f"{node.module}.{alias.name}" for alias in node.names}
            needed |= (names & NAMES.keys()) or {node.module or ""}

    return needed


@pytest.mark.parametrize("path", [*filter(dotted, MODULES)], ids=dotted)
def test_imports_point_to_lower_rows_and_at_public_names(path: Path) -> None:
    package = dotted(path).split(".")[0]
    for name in imported(path):
        own, _, rest = name.partition(".")
        other = rest.split(".")[0]
        if own != "scleraforce" or not other:
            continue

        allowed = other == package or ROW.get(other, len(ROWS)) < ROW[package]
        assert allowed, f"imports {name}, which is not of a lower row"
        private = re.match(r"_(?!_)", name.split(".")[-1])
        assert not private, f"imports {name}, a private name"


def test_no_imports_go_round() -> None:
    needs = {name: at_import(path) & NAMES.keys() for name, path in NAMES.items()}
    TopologicalSorter(needs).prepare()  # raises CycleError


WITH_LOOPS = [
    name
    for name, path in NAMES.items()
    if "base.compiled_loops import" in path.read_text(encoding="utf-8")
]


@pytest.mark.parametrize("name", WITH_LOOPS)
def test_machine_code_depends_on_every_source_that_its_module_imports(name) -> None:
    needed: set[str] = set()
    waiting = {name}
    while waiting:
        module = waiting.pop()
        needed.add(module)
        waiting |= (at_import(NAMES[module]) & NAMES.keys()) - needed

    sources = {one for one in needed if NAMES[one].name != "__init__.py"}
    deciding = _deciding(name.removeprefix("scleraforce."))
    assert sources <= {f"scleraforce.{one}" for one in deciding}


def test_each_package_is_of_a_row() -> None:
    packages = {path.name for path in ROOT.iterdir() if (path / "__init__.py").exists()}
    assert packages == {*ROW}


PACKAGES = [path for path in MODULES if path.name == "__init__.py" and dotted(path)]
MODULE_NAMES = {dotted(path) for path in MODULES if path.name != "__init__.py"}


@pytest.mark.parametrize("package", PACKAGES, ids=dotted)
def test_docstrings_of_packages_list_what_other_packages_import(package: Path) -> None:
    if dotted(package) == "lab.training":
        pytest.importorskip("torch")

    for public_name in docstring_names(package):
        module, _, name = public_name.rpartition(".")
        assert hasattr(import_module(module), name), f"{public_name} does not exist"

    for path in MODULES:
        if f"{dotted(path)}.".startswith(f"{dotted(package)}."):
            continue

        for name in imported(path):
            module = name.removeprefix("scleraforce.").rpartition(".")[0]
            if module in MODULE_NAMES and module.rpartition(".")[0] == dotted(package):
                assert name in docstring_names(package), f"imported by {path}"


def test_only_training_imports_torch_and_nothing_copyleft_is_imported() -> None:
    for path in MODULES:
        forbidden = (
            COPYLEFT
            if dotted(path).startswith("lab.training")
            else COPYLEFT | {"torch", "onnx"}
        )
        found = {name.split(".")[0] for name in imported(path)} & forbidden
        assert not found, f"{dotted(path)} imports {found}"


def test_pure_packages_touch_no_file_clock_socket_or_global_random_state() -> None:
    for path in MODULES:
        if dotted(path).startswith(tuple(PURE)) and dotted(path) not in IMPURE:
            check_that_it_is_pure(path)


def check_that_it_is_pure(path: Path) -> None:
    roots = {name.split(".")[0] for name in imported(path)}
    assert not roots & IMPURE_MODULES, (
        f"{dotted(path)} imports {roots & IMPURE_MODULES}"
    )
    files = (roots | imported(path)) & FILE_MODULES
    assert not files, f"{dotted(path)} imports {files}"

    for node in syntax_nodes(path):
        if isinstance(node, ast.Call):
            called = ast.unparse(node.func)
            assert called not in IMPURE_CALLS, (
                f"{dotted(path)}:{node.lineno}: {called}()"
            )
            method = (
                isinstance(node.func, ast.Attribute) and node.func.attr in FILE_CALLS
            )
            assert not method, f"{dotted(path)}:{node.lineno}: {called}()"
            drawn = re.match(r"(?:np|numpy)\.random\.(\w+)", called)
            assert not drawn or drawn[1] in {
                "default_rng",
                "SeedSequence",
            }, f"{dotted(path)}:{node.lineno}: {called}"

        if isinstance(node, ast.Attribute):
            assert ast.unparse(node) not in {
                "os.environ",
                "os.getenv",
            }, f"{dotted(path)}:{node.lineno}: environment"


def test_only_units_knows_the_factors_between_units() -> None:
    for path in MODULES:
        for node in syntax_nodes(path) if dotted(path) != "base.units" else ():
            if isinstance(node, ast.Constant) and isinstance(node.value, float):
                near = [
                    name
                    for name, factor in FACTORS.items()
                    if abs(node.value / factor - 1) < 4e-4
                ]
                assert not near, (
                    f"{dotted(path)}:{node.lineno}: {node.value}: take {near[0]} from"
                    " units"
                )


def test_only_the_package_itself_lists_its_public_names_and_no_record_reaches_into_another():
    texts = {dotted(path): path.read_text(encoding="utf-8") for path in MODULES}
    assert [
        name for name, text in texts.items() if re.search(r"^__all__", text, re.M)
    ] == [""]
    assert [name for name, text in texts.items() if "__dict__" in text] == [], (
        "use `dataclasses.replace`"
    )


def output_of(code: str) -> str:
    """Return what a fresh interpreter prints that runs some code without a fault."""
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_runtime_needs_numpy_opencv_and_onnx_runtime_only() -> None:
    """One interpreter imports them all."""
    block = (
        "import sys\n"
        "class Block:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        f"        if name.split('.')[0] in {BIG!r}:\n"
        "            raise ImportError(f'the runtime must not need {name}')\n"
        "sys.meta_path.insert(0, Block())\n"
        f"import {', '.join(f'scleraforce.{module}' for module in RUNTIME)}\n"
    )
    output_of(block)


@pytest.mark.slow
def test_commands_import_only_packages_that_they_use(tmp_path: Path) -> None:
    folder = tmp_path / "study"
    frame = write_one_frame(tmp_path / "session", recording_toml("mine"))
    unused = {
        "scipy.linalg",
        "scipy.sparse",
        "scipy.special",
        "matplotlib",
        "zarr",
        "torch",
        "onnx",
        "pydicom",
        "tifffile",
        "meshio",
        "pandas",
    }

    # a first reading compiles, which needs SciPy's BLAS
    read_one = f"run(['classify', 'default', {str(frame)!r}])"
    output_of(f"from scleraforce.front.cli.main import run; {read_one}")

    for command, others in (
        ("--help", {"numba", "numpy", "cv2", "torch", "matplotlib"}),
        (f"init {folder}", {"numba"}),
        (f"show {folder / 'study.toml'}", {"numba"}),
        (f"classify default {frame}", unused),
    ):
        script = (
            "import sys; from scleraforce.front.cli.main import run; assert"
            f" run({command.split()!r}) == 0\n"
        )
        output_of(f"{script}assert not {others!r} & set(sys.modules)")


@pytest.mark.slow
def test_few_tests_reach_behind_the_public_names_of_packages() -> None:
    """A move inside a package then breaks few tests; they are numerical claims that
    only an inner function can show.
    """
    tests = [
        names_behind(path, name)
        for path in Path(__file__).parent.rglob("test_*.py")
        for name in definitions(path)
        if name.startswith("test_")
    ]
    behind = [names for names in tests if names]
    assert "scleraforce.base.compiled_loops._deciding" in frozenset().union(*behind)
    assert len(behind) < 0.2 * len(tests)


FLAG = re.compile(r"(?<![\w-])--(?:[a-z][a-z0-9-]*|\{)")
OUTSIDE_CLI = [path for path in MODULES if not dotted(path).startswith("front.cli")]


@pytest.mark.parametrize("path", OUTSIDE_CLI, ids=dotted)
def test_only_the_command_line_spells_flags(path: Path) -> None:
    """Messages name fields in backquotes (`front/cli/field_flags`)."""
    assert FLAG.findall(path.read_text(encoding="utf-8")) == []


PAGE = Path(__file__).parents[1] / "docs" / "python.md"
PUBLIC = [name for name in scleraforce.__all__ if not name.startswith("__")]
HEAVY = [
    "torch",
    "scipy",
    "cv2",
    "onnxruntime",
    "numpy",
    "pydicom",
    "zarr",
    "matplotlib",
    "click",
    "tqdm",
    "scipy.linalg",
    "scipy.ndimage",
    "scipy.special",
]


def loaded_after(code: str) -> set[str]:
    """Return the heavy packages and our own modules that a fresh interpreter has
    imported after running some code.
    """
    show = (
        f"import sys; print(*[m for m in sys.modules if m in {HEAVY!r} or"
        " m.startswith('scleraforce')])"
    )
    return set(output_of(f"{code}\n{show}").split())


@pytest.mark.slow
def test_each_name_loads_only_its_own_imports() -> None:
    face = {"", ".front", ".front.api", ".front.api.public_names"}
    assert loaded_after("import scleraforce as sf; dir(sf)") == {
        f"scleraforce{name}" for name in face
    }
    loaded = loaded_after(
        "import scleraforce as sf; sf.Study; sf.InputError; sf.__version__"
    )
    assert "scleraforce.records.study" in loaded
    assert not loaded & {"torch", "scipy", "cv2", "onnxruntime", "zarr", "matplotlib"}
    loaded = loaded_after(
        "import scleraforce as sf; sf.segment; sf.load_model; sf.read;"
        " sf.read_recording"
    )
    assert {"cv2", "onnxruntime"} <= loaded
    assert not loaded & {"torch", "zarr", "matplotlib", "click", "tqdm"}
    loaded = loaded_after("import scleraforce as sf; sf.calibrate")
    # Numba imports SciPy's name
    assert not loaded & {*HEAVY} - {
        "scipy",
        "cv2",
        "onnxruntime",
        "numpy",
    }


@pytest.mark.slow
def test_nothing_public_loads_pytorch_before_it_trains() -> None:
    assert "torch" not in loaded_after(
        "import scleraforce as sf\nfor name in dir(sf): getattr(sf, name)"
    )


def test_the_page_type_checkers_python_and_dir_have_the_same_names() -> None:
    rows = re.findall(
        r"^\| `sf\.(\w+)", PAGE.read_text(encoding="utf-8"), flags=re.MULTILINE
    )
    assert sorted(rows) == sorted(PUBLIC)
    assert dir(scleraforce) == sorted(scleraforce.__all__)
    tree = ast.parse((ROOT / "__init__.pyi").read_text(encoding="utf-8"))
    typed = {
        alias.name: node.module
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom)
        and node.module
        and node.module.startswith("scleraforce.")
        for alias in node.names
    }
    assert sorted(typed) == sorted(scleraforce.__all__)

    for name, module in typed.items():
        assert getattr(scleraforce, name) is getattr(import_module(module), name)

    assert (ROOT / "py.typed").exists()
    packages = {path.stem for path in ROOT.iterdir()}
    assert not packages & set(PUBLIC), (
        "an import of the package would replace the function"
    )


def test_an_unknown_name_is_an_attribute_error_that_says_where_to_look() -> None:
    with pytest.raises(AttributeError, match=r"no attribute 'fish'; docs/python\.md"):
        scleraforce.fish  # noqa: B018
    with pytest.raises(ImportError):
        from scleraforce import fish  # noqa: F401


def test_every_public_name_has_an_example_and_takes_numbers_by_name() -> None:
    for name in PUBLIC:
        function = getattr(scleraforce, name)
        text = inspect.getdoc(function) or ""
        assert ">>> import scleraforce as sf" in text, name
        assert f"sf.{name}" in text, name

        for argument in (
            inspect.signature(function).parameters.values()
            if inspect.isfunction(function)
            else ()
        ):
            assert argument.annotation is not inspect.Parameter.empty, (
                f"{name}: {argument.name}"
            )
            by_name = argument.kind is inspect.Parameter.KEYWORD_ONLY
            assert by_name or "float" not in str(argument.annotation), (
                f"{name}: {argument.name}"
            )


def test_a_key_that_a_call_does_not_use_is_refused_by_name(tmp_path: Path) -> None:
    """The commands call the other functions (tests/front/cli/test_recordings.py)."""
    sealed, straps = (
        parse_study(f'[{name}]\nkind = "{kind}"')
        for name, kind in (("globe", "sealed"), ("supports", "straps"))
    )
    for call in (
        lambda: scleraforce.library_of(straps),
        lambda: scleraforce.train(analytic_library(), tmp_path / "out", straps),
        lambda: scleraforce.generate(tmp_path / "out", sealed, mechanics="linear"),
    ):
        with pytest.raises(StudyError, match=r"(globe|supports)\.kind: not used by `"):
            call()

    with pytest.raises(InputError, match="search"):
        scleraforce.train(analytic_library(), tmp_path / "out", search=True)

    assert not list(tmp_path.iterdir())


READERS = (
    load_classifier,
    load_force_reader,
    load_library,
    load_reader,
    open_calibration,
    open_dataset,
    open_library,
    read_calibration,
    read_frame,
    read_recording,
    read_study,
)


def test_a_path_that_is_a_string_and_does_not_exist_is_one_clear_line(
    tmp_path: Path,
) -> None:
    missing = str(tmp_path / "nothing")
    for read in READERS:
        faults = []
        for path in (missing, Path(missing)):
            with pytest.raises(InputError, match="nothing") as fault:
                read(path)  # type: ignore[operator]  # of various types
            faults.append(str(fault.value))

        assert faults[0] == faults[1], read
        assert "\n" not in faults[0], read
