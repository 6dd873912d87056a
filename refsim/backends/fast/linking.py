"""Functions that only other compiled functions call: they are linked in, and no machine code of their own is made.

Numba optimises each function with all that it calls, and makes machine code of it, in case Python calls it. A formula
and the body of a loop are called by kernels alone, which the compiler optimises together with what they call.
"""

import functools
from collections.abc import Callable
from typing import Any

from numba.extending import overload

from refsim.backends.fast.private import names, supported


@functools.cache
def _compiler() -> dict[str, Any]:
    """The option of `numba.jit` that leaves machine code out; none where it cannot be left out."""
    numba: Any = names("fast")
    if numba is None:
        return {}

    class Linked(numba.JITCodeLibrary):
        """Code to be linked into other code, with which it is optimised."""

        def _optimize_final_module(self) -> None:
            pass

        def _finalize_final_module(self) -> None:
            self._finalize_dynamic_globals()
            self._finalized = True

    @numba.register_pass(mutates_CFG=False, analysis_only=True)
    class WithoutMachineCode(numba.LoweringPass):
        _name = "refsim_without_machine_code"

        def __init__(self) -> None:  # abstract in Numba
            super().__init__()

        def run_pass(self, state: Any) -> bool:
            """Let the next pass write its code into a library that is only linked."""
            state.library = Linked(state.targetctx.codegen(), state.func_id.func_qualname)
            state.flags.no_compile = True
            return False

    @numba.register_pass(mutates_CFG=False, analysis_only=True)
    class Named(numba.LoweringPass):
        _name = "refsim_named"

        def __init__(self) -> None:
            super().__init__()

        def run_pass(self, state: Any) -> bool:
            """Give the function what stands for it where it is called: an object, in place of its machine code."""
            name = object().__reduce__  # of the type that Numba wants here
            state.cr = state.cr._replace(cfunc=name)
            state.targetctx.insert_user_function(name, state.cr.fndesc, [state.library])
            return False

    class Compiler(numba.CompilerBase):
        def define_pipelines(self) -> list[Any]:
            passes = numba.DefaultPassBuilder.define_nopython_pipeline(self.state)
            passes.add_pass_after(WithoutMachineCode, numba.AnnotateTypes)
            passes.add_pass_after(Named, numba.NativeLowering)
            passes.finalize()
            return [passes]

    return {"pipeline_class": Compiler}


def linked(function: Callable, chosen: Callable, targets: tuple[str, ...], **options: Any) -> None:
    """Let kernels for the targets call what `chosen` gives for the types of the arguments, where they call `function`.

    `options` are those of `numba.jit`.
    """
    for target in targets:
        more = supported(options) | (_compiler() if target == "cpu" else {})
        overload(function, target=target, jit_options=more, strict=False)(chosen)
