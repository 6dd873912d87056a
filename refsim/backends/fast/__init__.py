"""The fast road on a CPU: what needs private names of Numba, or LLVM written by hand.

`docs/guarantees.md` says what each part buys. REFSIM_PLAIN=1, or a name that is gone, has kernels run without all of it
(`refsim.backends.plain`).
"""
