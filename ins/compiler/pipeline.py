"""numba's compiler with less work, for kernels alone. Loads numba; `ins.jit` is its only caller.

What is left out does nothing to a kernel, so that the machine code does the same operations in the
same order:

- Of numba's passes those that look for what no kernel has (OMITTED). Each of them is followed by a
  new analysis of the function.
- What an operator is for given types is asked once, not at every place that it stands at: numba
  tries each time every meaning that the operator could have.
- A function that only kernels call is optimised and made machine code where it is called, no longer
  once by itself before.
- Python's garbage collector waits: there is nothing to collect, and it goes through all of it.

A kernel that needs an omitted pass (a comprehension, `inline="always"`) fails to compile.
"""

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from numba._dynfunc import make_function
from numba.core import codegen, compiler, targetconfig, typed_passes, types
from numba.core.compiler_machinery import register_pass

OMITTED = {
    "WithLifting",
    "InlineClosureLikes",
    "RewriteSemanticConstants",
    "DeadBranchPrune",
    "RewriteDynamicRaises",
    "MakeFunctionToJitFunction",
    "InlineInlinables",
    "FindLiterallyCalls",
    "LiteralUnroll",
    "LiteralPropagationSubPipelinePass",
    "InlineOverloads",
    "NopythonRewrites",
    "NoPythonSupportedFeatureValidation",
    "AnnotateTypes",
    "DumpParforDiagnostics",
}


class KernelLibrary(codegen.JITCodeLibrary):
    """The code of one function; of one that only kernels call it `waits` for its callers."""

    waits = False

    def finalize(self) -> None:
        """Link what is called and make machine code, unless the library waits."""
        if self.waits:
            self._finalized = True
            return
        self._linking_libraries = _callers_first(self)
        super().finalize()


def _callers_first(library: Any) -> list[Any]:
    """The libraries that a library needs, each before those that it calls: of what nothing calls
    yet LLVM links nothing.
    """
    done, order = {library}, []

    def visit(caller: Any) -> None:
        for called in caller._linking_libraries:
            if called in done:
                continue
            done.add(called)
            if getattr(called, "waits", False):  # others hold what they call already
                visit(called)
            order.append(called)

    visit(library)
    return order[::-1]


@register_pass(mutates_CFG=True, analysis_only=False)
class KernelLowering(typed_passes.NativeLowering):
    """numba's own lowering into a `KernelLibrary`."""

    _name = "kernel_lowering"

    def run_pass(self, state: Any) -> bool:
        """Lower one function.

        Parameters
        ----------
        state : numba.core.compiler.StateDict

        Returns
        -------
        changed : bool
        """
        library = KernelLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        library.enable_object_caching()
        state.library = library
        if not state.flags.no_cpython_wrapper:
            return bool(super().run_pass(state))
        library.waits = state.flags.no_compile = True
        changed = bool(super().run_pass(state))
        lowered = state["cr"]
        name = lowered.fndesc.qualname.split(".")[-1]
        # what numba knows the function by; there is no machine code to call
        entry = make_function(lowered.fndesc.lookup_module(), name, "", 0, lowered.env, (library,))
        state.targetctx.insert_user_function(entry, lowered.fndesc, [library])
        state["cr"] = lowered._replace(cfunc=entry)
        return changed


class KernelCompiler(compiler.CompilerBase):
    """numba's compiler, less what does nothing to a kernel: `njit(pipeline_class=...)`."""

    def compile_extra(self, func: Callable) -> Any:
        """Compile one function, and what it calls.

        Parameters
        ----------
        func : callable

        Returns
        -------
        result : numba.core.compiler.CompileResult
        """
        with _less_work():
            return super().compile_extra(func)

    def define_pipelines(self) -> list[Any]:
        """numba's passes without the omitted ones.

        Returns
        -------
        pipelines : list of numba.core.compiler_machinery.PassManager
        """
        passes = compiler.DefaultPassBuilder.define_nopython_pipeline(self.state)
        kept = compiler.PassManager("kernel")
        for made, description in passes.passes:
            if made.__name__ not in OMITTED:
                own = KernelLowering if made is typed_passes.NativeLowering else made
                kept.add_pass(own, description)
        kept.finalize()
        return [kept]


@contextmanager
def _less_work() -> Iterator[None]:
    """While a kernel is compiled, under numba's lock, with all that it calls."""
    function: Any = types.functions.BaseFunction
    ask = function.get_call_type
    if hasattr(ask, "known"):  # a kernel that another calls
        yield
        return
    known: dict[Any, tuple[Any, Any]] = {}

    def asked_once(self: Any, context: Any, args: Any, kws: Any) -> Any:
        flags = targetconfig.ConfigStack.top_or_none()
        inherited = flags and (flags.error_model, flags.forceinline, flags.nrt)
        key = id(self), inherited, tuple(args), tuple(sorted(dict(kws).items()))
        if key not in known:
            known[key] = self, ask(self, context, args, kws)  # self: its id stays its own
        return known[key][1]

    asked_once.known = known  # type: ignore[attr-defined]
    collecting = gc.isenabled()
    gc.disable()
    function.get_call_type = asked_once
    try:
        yield
    finally:
        function.get_call_type = ask
        if collecting:
            gc.enable()
