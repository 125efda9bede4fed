"""Bounds of prover and checker are sound and tight, and planted errors make them fail."""

from __future__ import annotations

import pytest

from tests.support.planted import planted
from tests.support.soundness import CHECKER, OF_CHECKER, OF_PROVER, PROVER, Checker, Prover

pytest.importorskip("onnx")
pytest.importorskip("onnxruntime")
pytest.importorskip("flint")


@pytest.mark.parametrize("part", OF_CHECKER)
def test_the_checker_is_sound_and_tight(part: str) -> None:
    OF_CHECKER[part](Checker(planted(CHECKER)))


@pytest.mark.parametrize("part", OF_PROVER)
def test_the_prover_is_sound_and_tight(part: str) -> None:
    OF_PROVER[part](Prover(planted(PROVER)))


CHECKER_ERRORS = [
    # Lines around activations.
    ("lines", "balls", "if z.upper() >= low and z.lower() <= high]", "if False]"),
    ("lines", "balls", "slope / 4, arb", "slope / 2, arb"),
    ("lines", "balls", "middle / 2, half / 2", "middle / 2, half / 4"),
    ("lines", "balls", "points += [arb(0)] if low < 0 < high else []", "pass"),
    ("lines", "balls", "half = ((highest - lowest) / 2)", "half = ((highest - lowest) / 3)"),
    ("lines", "balls", "half = ((highest - lowest) / 2)", "half = (highest - lowest)"),
    # Planes around networks.
    ("enclosures", "balls", "weight * offset + shift", "weight * offset"),
    ("enclosures", "balls", "for j in reversed(range(k)):", "for j in reversed(range(max(k - 1, 0), k)):"),
    ("enclosures", "balls", "reach = [a + b for a, b in zip", "reach = [a for a, b in zip"),
    ("enclosures", "balls", "errors = [s * c + e for", "errors = [e for"),
    ("enclosures", "balls", "gain = scaled(slopes[-1], gain)", "pass"),
    ("enclosures", "balls", "absolute = sizes(product)", "absolute = product"),
    ("enclosures", "balls", "return [sum((abs(x) for x in row), arb(0))", "return [sum((x for x in row), arb(0))"),
    # Motion.
    ("motions", "check", "remainder = [h**3 / 6 *", "remainder = [h**3 / 60 *"),
    ("motions", "check", "remainder = [h**3 / 6 *", "remainder = [h**3 *"),
    ("motions", "check", "sag = [(h * h / 8 *", "sag = [(h * h / 80 *"),
    ("motions", "check", "* widest * (h * h / 8)", "* widest * (h * h / 80)"),
    ("motions", "check", "* widest * (h * h / 8)", "* (h * h / 8)"),
    ("motions", "check", "* widest * (h * h / 8)", "* widest * (h * h)"),
    ("motions", "check", "largest += [f + e for f, e", "largest += [e for f, e"),
    ("motions", "check", "push * diagonal(errors))", "0 * push * diagonal(errors))"),
    ("motions", "check", "total = state + push * gain", "total = state"),
    ("motions", "check", "total * centre + push * offset", "total * centre"),
    ("motions", "check", "(loose * column(reach))", "(0 * loose * column(reach))"),
    ("motions", "check", "off = [a + b for a, b in zip((loose", "off = [a for a, b in zip((loose"),
    ("motions", "check", "(gain * spread, diagonal(errors))", "(gain * spread, 0 * diagonal(errors))"),
    ("motions", "check", "plus(plus(x, f, h), g, h * h / 2)", "plus(x, f, h)"),
    ("motions", "balls", "*e[k + 1 :]): e[k] * x", "*e[k + 1 :]): x"),
    ("motions", "check", "abs(c) + r for c, r in zip(centre", "c + r for c, r in zip(centre"),
    ("motions", "check", "arb(c.mid(), (r + c.rad()).upper())", "arb(c.mid(), r.upper())"),
    ("motions", "check", "off = [a + b + arb(n.rad()) for a, b, n", "off = [a + arb(n.rad()) for a, b, n"),
    ("explosions", "check", "if not larger.contains(x + (arb(0).union(h)) * value_at(f, grown)):", "if False:"),
    # Margins.
    ("margins", "check", "value / (arb(1) / _SIDES).cos_pi()", "value"),
    ("margins", "check", "_SIDES = 48", "_SIDES = 6"),
    ("margins", "check", "+ absolute_row_sums(row * state[1])[0]", ""),
    ("margins", "check", "for x in factors for state in (begin, end)", "for x in factors for state in (end,)"),
    ("margins", "check", "(base - _highest(x, state) - off).lower()", "(base - _highest(x, state)).lower()"),
    ("margins", "check", "+ sag[axis] for state in (begin, end)", "+ sag[axis] for state in (begin,)"),
    ("margins", "check", "_highest(sign * row, state) + sag[axis]", "_highest(sign * row, state)"),
    ("margins", "check", "base = -arb(limit[", "base = arb(limit["),
    ("margins", "check", "row[i] -= slope * arb(value) / norm", "row[i] -= slope * arb(value)"),
    ("margins", "check", "row[i] -= slope * arb(value) / norm", "row[i] += slope * arb(value) / norm"),
    ("margins", "check", 'off += sum((sag[i] ** 2 for i in limit["velocity"]), arb(0)).sqrt()', "pass"),
    ("margins", "check", 'zip(limit["velocity"], direction, strict=True)', "zip(position, direction, strict=True)"),
    ("margins", "check", 'if kind == "avoid" else (arb(high)', 'if kind == "within" else (arb(high)'),
    ("margins", "check", 'return max(margins) if kind == "avoid" else _least(margins)', "return max(margins)"),
    ("margins", "check", "x if x == x else -math.inf", "x if x == x else math.inf"),
    # Flights.
    ("flights", "check", '["keep"], begin, end, sag)', '["keep"], end, end, [arb(0)] * len(cell))'),
    ("flights", "check", 'if "end" in problem:', "if False:"),
    ("flights", "check", 'for _ in range(problem["steps"]):', "for _ in range(1):"),
    ("flights", "check", "diagonal([(arb(b) - arb(a)) / 2 for", "diagonal([(arb(b) - arb(a)) / 4 for"),
    ("flights", "check", "column([(arb(a) + arb(b)) / 2 for", "column([arb(a) for"),
    # Covers and verdicts.
    ("covers", "check", "if any(all(c <= a and b <= d for", "if any(any(c <= a and b <= d for"),
    ("covers", "check", "        if not cuts:", "        if not cuts:\n            continue\n        if not cuts:"),
    ("covers", "check", "parts = ((box[axis][0], edge), (edge, box[axis][1]))", "parts = ((box[axis][0], edge),)"),
    ("verdicts", "check", "if claim.network != hashlib.sha256(network).hexdigest():", "if False:"),
    ("verdicts", "check", "    _cover(box, claim.cells)\n", ""),
    ("verdicts", "check", "if not margin > 0.0:", "if not margin > -9.0:"),
    ("verdicts", "check", "least = min(least, margin)", "least = max(least, margin)"),
    # Reading.
    ("readings", "check_network", "    if not is_transposed:\n", "    if False:\n"),
    ("readings", "check_network", "    if not is_transposed:\n", "    if True:\n"),
    ("readings", "check_network", "layers[-1] = (*layers[-1][:2], operation)", "pass"),
    ("readings", "check_network", "reshape(count, -1))\n", "reshape(count, -1)[:, ::-1])\n"),
]  # fmt: skip
"""Part of the harness that must fail, module, text and error. Some make a bound useless, not unsound."""

PROVER_ERRORS = [
    ("lines", "relaxation", "point.clamp(min=low, max=high), (-point)", "low, (low)"),
    ("lines", "relaxation", "0.5 + 0.5 * offset, 0.5 * error", "0.5 + 0.5 * offset, 0.25 * error"),
    ("lines", "relaxation", "return 0.25 * slope", "return 0.5 * slope"),
    ("lines", "relaxation", "offset = 0.5 * (highest + lowest)\n", "offset = highest\n"),
    ("lines", "relaxation", "torch.zeros_like(low).clamp(min=low, max=high)", "low"),
    ("lines", "relaxation", "error = 0.5 * (highest - lowest) +", "error = highest - lowest +"),
    ("enclosures", "relaxation", "offset = offset @ weight.T + bias", "offset = offset @ weight.T"),
    ("enclosures", "relaxation", "error = rounding + _passed(layers, slopes, errors, number)", "error = rounding"),
    ("enclosures", "relaxation", "for k in reversed(range(number - 1)):", "for k in []:"),
    ("enclosures", "relaxation", "spread + _rows(gain.abs(), states.box) + error", "spread + error"),
    ("enclosures", "relaxation", "_rows(gain.abs(), states.box) + error", "_rows(gain.abs(), states.box)"),
    ("enclosures", "relaxation", "gain = gain * slope[:, None, :]", "pass"),
    ("enclosures", "relaxation", "errors[number - 1] @ weight.abs().T", "errors[number - 1] @ weight.T"),
    ("enclosures", "relaxation", "back * slopes[k + 1][", "back * slopes[1]["),
    ("enclosures", "relaxation", "@ layers[k + 1].weight", "@ layers[1].weight"),
    ("margins", "relaxation", "spread = spread + direction.abs() @ self.box", "direction.abs() @ self.box"),
    ("motions", "plants", "problem.period**2 / 8.0", "problem.period**2 / 80.0"),
    ("motions", "plants", "problem.period**2 / 8.0", "problem.period**2"),
    ("motions", "plants", "self._command * planes.error[", "0.0 * self._command * planes.error["),
    ("motions", "plants", "commands = commands + planes.offset.abs() + planes.error", "commands = planes.error"),
    ("motions", "plants", "gain = self._state + self._command @ planes.gain", "gain = self._state"),
    ("motions", "polynomial", "rest = self._h**3 / 6.0", "rest = self._h**3 / 60.0"),
    ("motions", "polynomial", "rest = self._h**3 / 6.0", "rest = self._h**3"),
    ("motions", "polynomial", "sag = self._h**2 / 8.0", "sag = self._h**2 / 80.0"),
    ("motions", "polynomial", "+ curved + rest + rounding", "+ rest + rounding"),
    ("motions", "polynomial", "+ curved + rest + rounding", "+ curved + rounding"),
    ("motions", "polynomial", "torch.cat((nothing, planes.error + 64.0", "torch.cat((nothing, 64.0"),
    ("motions", "polynomial", "value * key[number]", "value"),
    ("motions", "plants", "box = (gain.abs() @ states.box[:, :, None])[:, :, 0] + rounding", "box = rounding"),
    ("motions", "polynomial", "box = (jacobian.abs() @ both.box[:, :, None])[:, :, 0] +", "box ="),
    ("motions", "polynomial", "planes.gain * states.box[", "0.0 * planes.gain * states.box["),
    ("explosions", "polynomial", "grown = torch.where(fits[:, None], grown, torch.nan)", "pass"),
    ("margins", "prove", "stretched = self._round / np.cos(np.pi / _DIRECTIONS)", "stretched = self._round"),
    ("margins", "prove", "_DIRECTIONS = 64", "_DIRECTIONS = 6"),
    ("margins", "prove", "return keep.base - highest - sag * (1.0 + 1e-9)", "return keep.base - highest"),
    ("margins", "prove", "sag = sag + keep.slope * torch", "sag = sag + 0.0 * torch"),
    ("margins", "prove", "functions[:, :, position] -= keep.slope", "functions[:, :, position] += keep.slope"),
    ("margins", "prove", "functions[:, :, velocity] = stretched", "functions[:, :, position] = stretched"),
    ("margins", "prove", "sag * (1.0 + 1e-9) - keep.radius", "sag * (1.0 + 1e-9) + keep.radius"),
    ("margins", "prove", "nearest.amin(dim=0) - sag * (1.0 + 1e-9) -", "nearest.amin(dim=0) -"),
    ("margins", "prove", "torch.minimum(*inner) - piece.sag", "torch.minimum(*inner)"),
    ("margins", "prove", "(torch.minimum(*inner)", "(torch.maximum(*inner)"),
    ("margins", "prove", "for end in ends]).amax(dim=0) + piece.sag", "for end in ends]).amax(dim=0)"),
    ("margins", "prove", "lower - highest, lowest - upper)", "lower - highest, upper - lowest)"),
    ("flights", "prove", "if self.problem.end is not None:", "if False:"),
    ("flights", "prove", "        for _ in range(self.problem.steps):", "        for _ in range(1):"),
    ("flights", "prove", "radius = 0.5 * (ends[1] - ends[0])", "radius = 0.25 * (ends[1] - ends[0])"),
    ("flights", "prove", "least = torch.minimum(least, self._margin(piece))", "least = self._margin(piece)"),
    ("proofs", "prove", "holds = margins > 0.0", "holds = margins > -9.0"),
    ("proofs", "prove", "above[rows, axis] = middle", "above[rows, axis] = 0.9 * middle + 0.1 * high[rows, axis]"),
    ("proofs", "prove", "np.concatenate([low, above]), np.concatenate([below, high])", "low, below"),
    ("proofs", "prove", "len(self.open_low) == 0 and self.counterexample is None", "True"),
]  # fmt: skip


@pytest.mark.parametrize(("part", "module", "old", "new"), CHECKER_ERRORS)
def test_errors_of_the_checker_are_caught(part: str, module: str, old: str, new: str) -> None:
    wrong = Checker(planted(CHECKER, (f"rans_proof.{module}", old, new)))
    with pytest.raises((AssertionError, *wrong.refusals)):
        OF_CHECKER[part](wrong)


@pytest.mark.parametrize(("part", "module", "old", "new"), PROVER_ERRORS)
def test_errors_of_the_prover_are_caught(part: str, module: str, old: str, new: str) -> None:
    wrong = Prover(planted(PROVER, (f"rans_proof.{module}", old, new)))
    with pytest.raises(AssertionError):
        OF_PROVER[part](wrong)
