"""The operations of traced programs as vectors of LLVM."""

from __future__ import annotations

from rans.model.operations import Dialect

LLVM = Dialect(
    "LLVM",
    texts={
        **{"+": "fadd", "-": "fsub", "*": "fmul", "/": "fdiv", "neg": "fneg", "where": "select"},
        **{"abs": "real_function fabs", "sqrt": "real_function sqrt"},
        **{"floor": "real_function floor"},
        **{sign: f"fcmp_ordered {sign}" for sign in ("<", "<=", ">", ">=", "==")},
        "!=": "fcmp_unordered !=",
        **{"maximum": "larger", "minimum": "smaller"},
        **{"tanh": "tanh", "exp": "exp", "log1p": "log_one_plus"},
    },
    ints={
        **{"+": "add", "-": "sub", "*": "mul", "neg": "neg", ">>": "ashr", "real": "to_real"},
        **{"&": "and_", "|": "or_", "^": "xor"},
        **{sign: f"icmp_signed {sign}" for sign in ("<", "<=", ">", ">=", "==", "!=")},
        **dict.fromkeys(("abs", "maximum", "minimum"), ""),
    },
    bools={
        **{"&": "and_", "|": "or_", "^": "xor"},
        **{sign: f"icmp_signed {sign}" for sign in ("==", "!=")},
    },
)
"""Methods of `rans_machine_code.llvm.Code`, each with its first argument, which write an operation on vectors of
float32, of whole numbers and of truth values."""
