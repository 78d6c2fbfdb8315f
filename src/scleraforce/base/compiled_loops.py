"""Loops over arrays that Numba compiles: once for a user, at installation or at the
first call.

The machine code is cached under a hash of the sources, so that versions share no code,
and in a folder that nobody but the user writes to: loading it runs it.
Modules with such loops are imported only to read frames, to fit or to solve load paths,
as the import of Numba takes 0.2 s.
"""

import os
import pickle
import re
import sys
from collections.abc import Callable
from functools import cache
from hashlib import sha256
from importlib import import_module
from io import BytesIO
from pathlib import Path
from typing import Any, TypeVar, cast

from platformdirs import user_cache_path

from scleraforce.base.foreign_settings import leave_unread
from scleraforce.base.plain_text import printable
from scleraforce.base.private_folder import folder_fault, make_private, read_own

KEY_LETTERS = 32  # of the hash, in a file name
# Versions of Numba whose private parts are known here (`_code_file`, `_part_compiler`).
# They make compiling five times as fast and a start half a second shorter. With another
# version the public interface serves alone.
KNOWN = ("0.68",)
OPTIONS: Any = {"nogil": True, "fastmath": False, "error_model": "numpy"}
ROOT = Path(__file__).parents[1]
# Imports that may decide machine code: modules of the packages with loops, and of those
# below, whose constants are compiled in.
IMPORT = re.compile(
    r"^from scleraforce\."
    r"((?:base|fit|library|mechanics|recordings|records|wall)[\w.]*)"
    r" import (\([^)]*\)|.+)$",
    re.M,
)

Loops = TypeVar("Loops", bound=Callable[..., object])


def compiled(loops: Loops) -> Loops:
    """Return a function of loops over arrays as machine code.

    It is compiled at the first call with arguments of some types, which takes seconds,
    and cached for all later processes. It runs without the lock of the interpreter, and
    rounds as the plain function does.
    """
    folder = _code_folder(loops.__module__.removeprefix("scleraforce."))
    if not _is_known():
        return _publicly_compiled(loops, folder)

    dispatcher: Any = _numba().njit(**OPTIONS)(loops)
    # Before it loads machine code, Numba reads the metadata of all installed packages,
    # for 15 ms, to find extensions of itself; these loops use none.
    dispatcher._compilation_chain_init_hook = _find_no_extensions
    if folder is not None:
        dispatcher._cache = _code_file()(loops)
    return cast(Loops, dispatcher)


def _find_no_extensions() -> None:
    """Do nothing."""


def compiled_part(loops: Loops, counts: bool = True) -> Loops:
    """Return a function of loops that only other compiled functions call: it is
    compiled and cached within them.
    """
    if not _is_known():
        return cast(Loops, _numba().njit(**OPTIONS)(loops))

    options: Any = {
        "no_cpython_wrapper": True,
        "no_cfunc_wrapper": True,
        "pipeline_class": _part_compiler(),
        "_nrt": counts,
    }
    return cast(Loops, _numba().njit(**OPTIONS, **options)(loops))


def compiled_in_place(loops: Loops) -> Loops:
    """Return a part that makes and returns no array: without counts of references it
    takes a third of the time.

    Numba counts each look at an array of a tuple, and refuses to compile a part that
    makes an array without counts.
    """
    return compiled_part(loops, counts=False)


def _is_known() -> bool:
    """Return whether the private parts of this Numba are known here."""
    return _numba().__version__.rpartition(".")[0] in KNOWN


def _publicly_compiled(loops: Loops, folder: Path | None) -> Loops:
    """Return a function that Numba compiles and caches by itself.

    It takes minutes once, and half a second more at each start.
    """
    numba = _numba()
    _note(
        f"Numba {numba.__version__}: loops compile in minutes and load slowly; with"
        f" Numba {', '.join(KNOWN)} in half a minute"
    )
    is_kept = folder is not None and _is_made(folder)
    if is_kept:
        numba.config.CACHE_DIR = str(folder)
    return cast(Loops, numba.njit(cache=is_kept, **OPTIONS)(loops))


def _is_made(folder: Path) -> bool:
    """Make the folder of a module's machine code; note why if it cannot be made."""
    try:
        make_private(folder)
    except OSError as fault:
        _note_unkept(folder, fault)
        return False

    return True


def _note_unkept(folder: Path, fault: OSError) -> None:
    """Note, once for all modules, why machine code is not kept in their folders."""
    _note(
        f"{folder.parent}: machine code is not kept, and made at each start:"
        f" {fault.strerror or fault}"
    )


@cache
def _numba() -> Any:
    """Import Numba, which reads no settings in the current folder."""
    leave_unread("numba.core.config")
    numba = import_module("numba")
    # where another module has imported it: it reads them before each compilation
    config: Any = import_module("numba.core.config")
    config._config_fname = os.devnull
    return numba


@cache
def _part_compiler() -> Any:
    """Return Numba's compiler of parts: LLVM optimises each only within its callers,
    not once more for every level.
    """
    codegen, compiler = (
        import_module(f"numba.core.{name}") for name in ("codegen", "compiler")
    )

    class PartCode(codegen.JITCodeLibrary):  # type: ignore[misc, name-defined]
        def finalize(self) -> None:
            for library in dict.fromkeys(self._linking_libraries):
                self._reload_init.update(library._reload_init)
                self._final_module.link_in(
                    library._get_module_for_linking(), preserve=True
                )

            environments = [
                each.name
                for each in self._final_module.global_variables
                if "NumbaEnv" in each.name
            ]
            named = "\n".join(
                f'@"{name}" = common global i8* null' for name in environments
            )
            self._codegen._add_module(codegen.ll.parse_assembly(named))
            self._finalize_dynamic_globals()
            self._finalized = True

    class PartCompiler(compiler.Compiler):  # type: ignore[misc, name-defined]
        def compile_extra(self, function: Any) -> Any:
            target = self.state.targetctx.codegen()
            self.state.library = PartCode(target, function.__qualname__)
            self.state.library.enable_object_caching()
            return super().compile_extra(function)

    return PartCompiler


@cache
def _code_file() -> Any:
    """Return the class of a function's machine code on disk, which is loaded without
    the compiler's modules.

    Numba would import its implementations of all functions first, which takes longer
    than the import of Numba, and parse each function's form for the linker, which only
    the compilation of a caller needs.
    """
    event, caching, codegen, environment = (
        import_module(f"numba.core.{name}")
        for name in ("event", "caching", "codegen", "environment")
    )

    def environment_of(module: str, constants: list[Any], name: str) -> Any:
        """Return a called function's environment; its globals serve the interpreter
        only, so no module is imported.
        """
        found = environment.lookup_environment(name)
        if found is None:
            found = environment.Environment({"__name__": module})
            found.env_name = name
            found.consts[:] = constants
            environment.Environment._memo[name] = found

        return found

    class Unpickler(pickle.Unpickler):
        def find_class(self, module: str, name: str) -> Any:
            return (
                environment_of
                if name == "_rebuild_env"
                else super().find_class(module, name)
            )

    class Locator(caching._CacheLocator):  # type: ignore[misc, name-defined]  # Numba has hardly any types
        """The folder of a module's machine code, the same for every copy of the package
        with the same sources.
        """

        def __init__(self, loops: Callable[..., object], _: str) -> None:
            folder = _code_folder(loops.__module__.removeprefix("scleraforce."))
            assert folder is not None  # else the function has no code file
            self._folder = folder
            self._line = loops.__code__.co_firstlineno

        @classmethod
        def from_function(cls, loops: Callable[..., object], file: str) -> "Locator":
            return cls(loops, file)

        def get_cache_path(self) -> str:
            return str(self._folder)

        def ensure_cache_path(self) -> None:
            make_private(self._folder)
            super().ensure_cache_path()

        def get_source_stamp(self) -> str:
            return ""  # the folder's name has the hash of the sources

        def get_disambiguator(self) -> str:
            return str(self._line)

    class Code(caching.CompileResultCacheImpl):  # type: ignore[misc, name-defined]
        _locator_classes = (Locator,)

        def reduce(self, result: Any) -> Any:
            """Return what the file holds; of the environments of called functions those
            with constants alone: nothing looks at the others, 25 a function.
            """
            *parts, called = super().reduce(result)
            return (*parts, tuple(each for each in called if each.consts))

    class IndexFile(caching.IndexDataCacheFile):  # type: ignore[misc, name-defined]
        """The files of a function, which are not unpickled unless they are the
        user's.
        """

        def _load_index(self) -> dict[Any, str]:
            try:
                file = BytesIO(read_own(Path(self._index_path)))
            except FileNotFoundError:
                return {}

            try:
                if pickle.load(file) != self._version:
                    return {}
                stamp, overloads = pickle.load(file)
            except Exception:
                # a damaged file may raise anything: the index is written anew
                return {}

            return overloads if stamp == self._source_stamp else {}

        def _load_data(self, name: str) -> Any:
            return Unpickler(BytesIO(read_own(Path(self._data_path(name))))).load()

    class CachedCode(codegen.JITCodeLibrary):  # type: ignore[misc, name-defined]
        _shared_module: Any

        @classmethod
        def _unserialize(cls, target: Any, state: Any) -> Any:
            name, _, (object_code, bitcode) = state
            library = cls(target, name)
            library._bitcode = bitcode
            library.enable_object_caching()
            library._set_compiled_object(object_code)
            library._finalize_final_module()

            return library

        def _get_module_for_linking(self) -> Any:
            if self._shared_module is None:
                self._shared_module = codegen.ll.parse_bitcode(self._bitcode)
                self.codegen._engine._load_defined_symbols(self._shared_module)
            return self._shared_module

        def get_pointer_to_function(self, name: str) -> Any:
            return self.codegen._engine.get_function_address(name)

    class CodeFile(caching.FunctionCache):  # type: ignore[misc, name-defined]
        _impl_class = Code

        def __init__(self, loops: Callable[..., object]) -> None:
            super().__init__(loops)
            self._cache_file.__class__ = IndexFile

        def save_overload(self, signature: Any, data: Any) -> None:
            try:
                super().save_overload(signature, data)
            except OSError as fault:
                _note_unkept(Path(self.cache_path), fault)

        def load_overload(self, signature: Any, target_context: Any) -> Any:
            _link_runtime()
            target = target_context.codegen()
            # under the lock of Numba's compiler
            before = target._library_class
            target._library_class = CachedCode

            try:
                return self._load_overload(signature, target_context)
            except Exception:
                # a damaged file may raise anything: the function is compiled anew
                return None
            finally:
                target._library_class = before

    class Notice(event.Listener):  # type: ignore[misc, name-defined]
        """The first compilation of this process says so."""

        said = False

        def on_start(self, event: Any) -> None:  # noqa: ARG002 - as Numba calls it
            if not self.said:
                sys.stderr.write("compiling, once: half a minute\n")
                sys.stderr.flush()
            self.said = True

        def on_end(self, event: Any) -> None:
            """Do nothing."""

    event.register("numba:compile", Notice())
    return CodeFile


@cache
def _link_runtime() -> None:
    """Tell LLVM where the functions of Numba's runtime are that loaded code calls.

    Numba would also compile what only the compilation of loops needs, for 15 ms; it
    does so when it compiles.
    """
    runtime = import_module("numba.core.runtime._nrt_python")
    binding = import_module("llvmlite.binding")
    for name, address in runtime.c_helpers.items():
        # as in `numba.core.runtime.nrt`
        binding.add_symbol(name if name.startswith("_") else f"NRT_{name}", address)


@cache
def _code_folder(module: str) -> Path | None:
    """Return the folder of a module's machine code; None, with a note, if another user
    could have put code there.
    """
    content = b"".join(_source(name)[0] for name in sorted(_deciding(module)))
    folder = (
        user_cache_path("scleraforce")
        / "compiled"
        / f"{module}-{sha256(content).hexdigest()[:KEY_LETTERS]}"
    )
    if fault := folder_fault(folder):
        _note(f"{fault}: loops are compiled each time; remove it, or change its mode")
        return None

    return folder


@cache
def _note(text: str) -> None:
    sys.stderr.write(printable(f"note: {text}") + "\n")
    sys.stderr.flush()


def _deciding(module: str) -> set[str]:
    """Return the modules that decide a module's machine code: Numba does not notice a
    change of a called function.
    """
    found: set[str] = set()
    waiting = [module, "base.compiled_loops"]

    while waiting:
        name = waiting.pop()
        if name not in found and _source(name)[0]:
            found.add(name)
            waiting += _source(name)[1]

    return found


@cache
def _source(module: str) -> tuple[bytes, tuple[str, ...]]:
    """Return a module's source, and what it imports that may decide machine code; b""
    if there is no such module.
    """
    # as text: a start asks for a hundred modules, and a `Path` of each took 5 ms
    name = os.path.join(ROOT, *module.split(".")) + ".py"
    try:
        with open(name, "rb") as file:
            content = file.read()
    except (FileNotFoundError, NotADirectoryError):
        return b"", ()

    imports = list[str]()
    for imported, names in IMPORT.findall(content.decode()):
        imports.append(imported)
        # of a package: its modules
        imports += (f"{imported}.{name}" for name in re.findall(r"\w+", names))

    return content, tuple(imports)
