"""All warnings of RANS have classes of RANS, so that a user can filter them without their texts."""

import ast
import warnings

import pytest

import rans
from tests.support.processes import ROOT
from tests.support.sources import sources


def test_every_warning_has_a_class_of_rans():
    others, count = [], 0
    for _, file in sources():
        text = file.read_text("utf-8")
        if "warn(" not in text:
            continue
        for node in ast.walk(ast.parse(text)):
            if not isinstance(node, ast.Call) or ast.unparse(node.func) != "warnings.warn":
                continue
            count += 1
            category = ast.unparse(node.args[1]) if len(node.args) > 1 else ""
            if category != "RansWarning":
                others.append(f"{file.relative_to(ROOT)}:{node.lineno}: {category}")
    assert not others
    assert count > 15  # or the search itself is broken


def test_warnings_of_rans_can_be_made_errors_and_those_of_others_left():
    craft = rans.load_spacecraft("floating-platform")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        warnings.filterwarnings("error", category=rans.RansWarning)
        warnings.warn("of somebody else", UserWarning, stacklevel=1)
        with pytest.raises(rans.RansWarning, match="may violate"):
            rans.LQR(craft, rans.Avoid())
