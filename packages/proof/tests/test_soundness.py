"""Bounds of prover and checker are sound and tight, and planted errors make them fail."""

from __future__ import annotations

from typing import Any

import pytest

from .planted import planted
from .soundness import CHECKER, OF_CHECKER, OF_PROVER, PROVER, Checker, Prover

pytest.importorskip("onnx")
pytest.importorskip("onnxruntime")
pytest.importorskip("flint")
_SLOW = (pytest.mark.slow,)
"""A motion of the prover takes it some tenths of a second, whatever the number of sets."""


@pytest.mark.parametrize("part", OF_CHECKER)
def test_the_checker_is_sound_and_tight(part: str) -> None:
    OF_CHECKER[part](Checker(planted(CHECKER)))


@pytest.mark.parametrize(
    "part", [pytest.param(part, marks=_SLOW if part == "motions" else ()) for part in OF_PROVER]
)
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
    ("enclosures", "balls", "weight * offset + bias, weight", "weight * offset, weight"),
    ("enclosures", "balls", "side_by_side(scaled(slopes, noise), diagonal(half))", "diagonal(half)"),
    ("enclosures", "balls", "absolute_row_sums(noise), off, strict=True)", "off, off, strict=True)"),
    ("enclosures", "balls", "side_by_side(scaled(slopes, noise), ", "side_by_side(noise, "),
    ("enclosures", "balls", "gain, noise = scaled(slopes, gain), side", "gain, noise = gain, side"),
    ("enclosures", "balls", "diagonal(half))", "diagonal([x / 2 for x in half]))"),
    ("enclosures", "balls", "offset, absolute_row_sums(noise)", "offset, [sum(x, arb(0)) for x in noise.tolist()]"),
    ("enclosures", "balls", "return [sum((abs(x) for x in row), arb(0))", "return [sum((x for x in row), arb(0))"),
    # Motion.
    ("motions", "check_motion", "series = self._series(start, _TERMS - 1)",
        "series = self._series(start, _TERMS - 3)"),
    ("linear motions", "check_motion", "a + b + r + arb(x.rad())", "a + b + arb(x.rad())"),
    ("motions", "check_motion", "a + b + r + arb(x.rad())", "a + r + arb(x.rad())"),
    ("motions", "check_motion", "a + b + r + arb(x.rad())", "b + r + arb(x.rad())"),
    ("motions", "check_motion", "(h * h / 4 * abs(x[2]))", "(h * h / 40 * abs(x[2]))"),
    ("motions", "check_motion", "        ctx.cap = _TERMS + 1 ", "        ctx.cap = 1 "),
    ("bends", "check_motion", "k: p * b.over for", "k: p * b.at for"),
    ("bends", "check_motion", "+ self.at * q if k in slopes else self.at * q",
        "+ b.at * q if k in slopes else b.at * q"),
    ("bends", "check_motion", "self.at * b.at, self.over * b.over", "self.at * b.at, self.at * b.over"),
    ("bends", "check_motion", "self.over - self.at) * second", "self.at - self.at) * second"),
    ("bends", "check_motion", "slope = first + (", "slope = first + 4 * ("),
    ("bends", "check_motion", "(x.sin(), x.cos(), -x.sin())", "(x.sin(), -x.cos(), -x.sin())"),
    ("bends", "check_motion", "(x.cos(), -x.sin(), -x.cos())", "(x.cos(), -x.cos(), -x.cos())"),
    ("bends", "check_motion", "(x.exp(), x.exp(), x.exp())", "(x.exp(), -x.exp(), x.exp())"),
    ("bends", "check_motion", "-1 / (x * x), 2 /", "1 / (x * x), 2 /"),
    ("bends", "check_motion", "half / x.sqrt(), -half", "1 / x.sqrt(), -half"),
    ("bends", "check_motion", "return self.sin() / self.cos()", "return self.sin() * self.cos()"),
    ("motions", "check_motion", "operator.sub", "lambda a, b: b - a"),
    ("motions", "check_motion", "operator.truediv", "lambda a, b: b / a"),
    ("bends", "check_motion", "return lambda values: -inner(values)", "return inner"),
    ("linear motions", "check_motion", "side_by_side(gain * spread, diagonal(errors))",
        "side_by_side(gain * spread, 0 * diagonal(errors))"),
    ("linear motions", "check_motion", "(gain * centre + offset).entries()", "offset.entries()"),
    ("motions", "check_motion", "row in (fixed * wide).tolist()", "row in (slopes * 0 * wide).tolist()"),
    ("motions", "check_motion", "_ball(c.mid(), w + c.rad())", "_ball(c.mid(), w)"),
    ("explosions", "check_motion", "        return None\n\n\ndef reduced", "        return guess\n\n\ndef reduced"),
    ("reductions", "check_motion", "diagonal(absolute_row_sums(along))",
        "diagonal([x[0] for x in along.tolist()])"),
    ("reductions", "check_motion", "(order[:kept].tolist(), order[kept:].tolist())",
        "(order[:kept].tolist(), order[kept + 1:].tolist())"),
    ("reductions", "check_motion", "side_by_side(first, box, diagonal(left))", "side_by_side(first, box)"),
    ("reductions", "check_motion", "scale * np.linalg.svd((table / scale)[:, order[kept:]])[0]",
        "np.diag(scale[:, 0])"),
    # Margins.
    ("margins", "check_property", "value / (arb(1) / _SIDES).cos_pi()", "value"),
    ("margins", "check_property", "_SIDES = 48", "_SIDES = 6"),
    ("margins", "check_property", "+ absolute_row_sums(row * state[1])[0]", ""),
    ("margins", "check_property", "for x in factors for state in (begin, end)",
        "for x in factors for state in (end,)"),
    ("margins", "check_property", "(base - _highest(x, state) - off).lower()",
        "(base - _highest(x, state)).lower()"),
    ("margins", "check_property", "state) - off for state in (begin, end)]", "state) - off for state in (begin,)]"),
    ("margins", "check_property", "_highest(-row, state) - off", "_highest(-row, state)"),
    ("margins", "check_property", "sign * row, -sign * low", "sign * row, sign * low"),
    ("margins", "check_property", "-sign * row, sign * high", "-sign * row, high"),
    ("margins", "check_property", "arb_mat(1, count, factors), constant)",
        "arb_mat(1, count, factors), 0 * constant)"),
    ("margins", "check_property", "abs(hull[i]).upper() + sag[i]", "abs(hull[i]).upper()"),
    ("margins", "check_property", "hulls = [hull(state) for state in (begin, end)]", "hulls = [hull(begin)]"),
    ("margins", "check_property", "x + arb(0, w.upper()) for x, w", "x for x, w"),
    ("margins", "check_property", "else -limit[", "else limit["),
    ("margins", "check_property", "row[i] -= slope * value / _norm(ahead)", "row[i] -= slope * value"),
    ("margins", "check_property", "row[i] -= slope * value / _norm(ahead)",
        "row[i] += slope * value / _norm(ahead)"),
    ("margins", "check_property", 'off += _norm(sag[i] for i in limit["velocity"])', "pass"),
    ("margins", "check_property", 'zip(limit["velocity"], direction, strict=True)',
        "zip(position, direction, strict=True)"),
    ("margins", "check_property", "return least_of(margins) if self._is_every else max(margins)",
        "return max(margins)"),
    ("margins", "check_property", 'self._kind in ("within", "every")', 'self._kind in ("within",)'),
    ("margins", "check_property", "x if x == x else -math.inf", "x if x == x else math.inf"),
    # Flights.
    ("flights", "check", "self._keep.margin(begin, end, sag)", "self._keep.margin(end, end, still)"),
    ("flights", "check", "return least if self._end is None else min(least, at_end)", "return least"),
    ("flights", "check", 'for number in range(self._problem["steps"]):', "for number in range(1):"),
    ("flights", "check", "                centre, spread = end\n", "                centre, _ = end\n"),
    ("options", "check", "number + 1 >= self._earliest:\n                at_end =",
        "number + 2 >= self._earliest:\n                at_end ="),
    ("options", "check", "at_end = max(at_end,", "at_end = min(at_end,"),
    ("options", "check", "number >= self._begins:\n                least", "True:\n                least"),
    ("options", "check", "number >= self._begins:\n                least",
        "number > self._begins + 1:\n                least"),
    ("options", "check", "gain * shift + offset, errors", "offset, errors"),
    ("options", "check_motion", "row.append(result.at[0])", "row.append(arb(0))"),
    ("options", "check", "taken = table * centre + shift,", "taken = table * centre,"),
    ("flights", "check", "diagonal([(b - a) / 2 for", "diagonal([(b - a) / 4 for"),
    ("flights", "check", "[(a + b) / 2 for a, b in ends]", "[a for a, b in ends]"),
    # Flights that refute.
    ("refutations", "check", "need(worst < 0.0, f", "need(True, f"),
    ("refutations", "check", "need(is_near, ", "need(True, "),
    ("refutations", "check", "lowest = [float(x.upper())", "lowest = [float(x.lower()) - 0.01"),
    ("refutations", "check", "is_start = all(", "is_start = any("),
    ("refutations", "check", "lowest.append(max(float", "lowest.append(min(float"),
    ("refutations", "check_property", "self._is_every else arb.max, values",
        "not self._is_every else arb.max, values"),
    ("refutations", "check_property", 'away if self._kind == "keep_out" else -away', "-away"),
    ("refutations", "check_property", "distance - speed", "distance + speed"),
    # Covers, halves and verdicts.
    ("covers", "check", "if any(all(c <= a and b <= d for", "if any(any(c <= a and b <= d for"),
    ("covers", "check", "        need(cuts, f", "        if not cuts:\n            continue\n        need(cuts, f"),
    ("covers", "check", "parts = ((box[axis][0], edge), (edge, box[axis][1]))", "parts = ((box[axis][0], edge),)"),
    ("halves", "check", "for part in ((low, cut), (cut, high)):", "for part in ((low, cut),):"),
    ("halves", "check", "for part in ((low, cut), (cut, high)):", "for part in ((cut, high),):"),
    ("halves", "check", "return min(margins)", "return max(margins)"),
    ("halves", "check", "if margin > 0.0 or not depth:", "if True:"),
    ("halves", "check", "cut = low + (high - low) / 2", "cut = low"),
    ("verdicts", "check", "need(claim.network == digest, ", "need(True, "),
    ("verdicts", "check", "    _cover(box, claim.cells)\n", "    pass\n"),
    ("verdicts", "check", "need(margin > 0.0, f", "need(margin > -9.0, f"),
    ("verdicts", "check", "least = min(least, margin)", "least = max(least, margin)"),
    # Reading.
    ("readings", "network_reader", 'w if attributes.get("transB") else w.T', "w"),
    ("readings", "network_reader", 'w if attributes.get("transB") else w.T', "w.T"),
    ("readings", "network_reader", "_rounded(linear, node.op_type, ", "_rounded(linear, '', "),
    ("readings", "network_reader", "w.reshape(len(w), -1))", "w.reshape(len(w), -1)[:, ::-1])"),
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
    ("linear motions", "plants", "problem.period**2 / 8.0", "problem.period**2 / 80.0"),
    ("linear motions", "plants", "problem.period**2 / 8.0", "problem.period**2"),
    ("linear motions", "plants", "self._command * planes.error[", "0.0 * self._command * planes.error["),
    ("linear motions", "plants", "commands = commands + planes.offset.abs() + planes.error",
        "commands = planes.error"),
    ("linear motions", "plants", "gain = self._state + self._command @ planes.gain", "gain = self._state"),
    ("linear motions", "plants", "box = (gain.abs() @ states.box[:, :, None])[:, :, 0] + rounding",
        "box = rounding"),
    ("motions", "motion", "end.error + rest * (1.0 + 1e-12)", "end.error"),
    ("motions", "motion", "0.25 * h * h * (second", "0.025 * h * h * (second"),
    ("motions", "motion", "0.25 * h * h * (second", "4.0 * h * h * (second"),
    ("bends", "motion", "error + reach[0] * reach[1] - 0.5 * squares.abs()", "error - 0.5 * squares.abs()"),
    ("bends", "motion", "a.centre * b.centre + 0.5 * squares.sum(dim=2)", "a.centre * b.centre"),
    ("motions", "motion", "error = a.centre.abs() * b.error + b.centre.abs() * a.error", "error = 0.0 * a.error"),
    ("bends", "motion", "value + 0.5 * (low + high)", "value + low + high"),
    ("motions", "motion", "slope.abs() * x.error + 0.5 * (high - low)", "slope.abs() * x.error"),
    ("bends", "motion", "(0.5, cosine, -sine)", "(0.5, cosine, sine)"),
    ("bends", "motion", "bent(x, value, slope, (-highest, -lowest))",
        "bent(x, value, slope, (0.0 * highest, 0.0 * lowest))"),
    ("bends", "motion", "-(value**2), (widened[0]", "value**2, (widened[0]"),
    ("bends", "motion", "bent(x, value, 0.5 / value", "bent(x, value, 1.0 / value"),
    ("motions", "motion", "a[i].times(i / k), own[k - i]) for i in range(1, k + 1)]\n                return (",
        "a[i].times(1.0), own[k - i]) for i in range(1, k + 1)]\n                return ("),
    ("motions", "motion", "return convolution([(own[0], rest.times(-1.0))])",
        "return convolution([(own[0], rest)])"),
    ("motions", "motion", "_inverse(own[0].times(2.0)), rest", "_inverse(own[0]), rest"),
    ("motions", "motion", ".times(1.0 / (k + 1)))", ".times(1.0))"),
    ("motions", "motion", "lower = torch.cat((planes.gain @ wide, torch.diag_embed(wrong))",
        "lower = torch.cat((planes.gain @ wide, 0.0 * torch.diag_embed(wrong))"),
    ("motions", "motion", "(states.generators, torch.diag_embed(states.box))",
        "(states.generators, 0.0 * torch.diag_embed(states.box))"),
    ("explosions", "motion", "Form(torch.where(fits, form.centre, torch.nan), form", "Form(form.centre, form"),
    ("reductions", "prove", "states.box + off", "states.box"),
    ("reductions", "prove", "half = along.abs().sum", "half = along.sum"),
    ("reductions", "prove", "left.sum(dim=2) *", "0.0 *"),
    ("reductions", "prove", "_SMALLER)[:, None, None], axes, eye)",
        "_SMALLER)[:, None, None], eye, eye)"),
    ("options", "prove", "number >= self.problem.begins", "number >= 0"),
    ("options", "prove", "number + 1 >= earliest", "number + 2 >= earliest"),
    ("options", "prove", "bias = first.weight @ inputs[1] + first.bias", "bias = first.bias"),
    ("margins", "prove", "stretched = self._round / np.cos(np.pi / _DIRECTIONS)", "stretched = self._round"),
    ("margins", "prove", "_DIRECTIONS = 64", "_DIRECTIONS = 6"),
    ("margins", "prove", "return keep.base - highest - sag * (1.0 + 1e-9)", "return keep.base - highest"),
    ("margins", "prove", "sag = sag + keep.slope * torch", "sag = sag + 0.0 * torch"),
    ("margins", "prove", "functions[:, :, position] -= keep.slope", "functions[:, :, position] += keep.slope"),
    ("margins", "prove", "functions[:, :, velocity] = stretched", "functions[:, :, position] = stretched"),
    ("margins", "prove", "sag * (1.0 + 1e-9) - keep.radius", "sag * (1.0 + 1e-9) + keep.radius"),
    ("margins", "prove", "nearest.amin(dim=0) - sag * (1.0 + 1e-9) -", "nearest.amin(dim=0) -"),
    ("margins", "prove", "constants - piece.sag @ functions.abs().T * (1.0 + 1e-9)", "constants"),
    ("margins", "prove", "value = lowest.amin(dim=0) + constants", "value = lowest.amax(dim=0) + constants"),
    ("margins", "prove", "return value.amin(dim=1) if every else value.amax(dim=1)", "return value.amax(dim=1)"),
    ("margins", "prove", "(end.size + piece.sag)[:, position]", "end.size[:, position]"),
    ("margins", "prove", "(-np.array(box.lower), box.upper)", "(np.array(box.lower), box.upper)"),
    ("flights", "prove", "else torch.minimum(least, at_end)", "else least"),
    ("flights", "prove", "for number in range(self.problem.steps):", "for number in range(1):"),
    ("flights", "prove", "radius = 0.5 * (ends[1] - ends[0])", "radius = 0.25 * (ends[1] - ends[0])"),
    ("flights", "prove", "least = torch.minimum(least, self._margin(piece))", "least = self._margin(piece)"),
    ("proofs", "prove", "holds = margins > 0.0", "holds = margins > -9.0"),
    ("proofs", "prove", "above[rows, axis] = middle", "above[rows, axis] = 0.9 * middle + 0.1 * high[rows, axis]"),
    ("proofs", "prove", "np.concatenate([low, above]), np.concatenate([below, high])", "low, below"),
    ("proofs", "prove", "len(self.open_low) == 0 and self.counterexample is None", "True"),
]  # fmt: skip


def by_turns(errors: list[tuple[str, str, str, str]]) -> list[Any]:
    """Every third error by default, and all of them with the slow tests; motions take longer."""
    return [
        pytest.param(*error, marks=_SLOW if number % 3 or error[0] == "motions" else ())
        for number, error in enumerate(errors)
    ]


@pytest.mark.parametrize(("part", "module", "old", "new"), by_turns(CHECKER_ERRORS))
def test_errors_of_the_checker_are_caught(part: str, module: str, old: str, new: str) -> None:
    wrong = Checker(planted(CHECKER, (f"rans_proof.{module}", old, new)))
    with pytest.raises((AssertionError, *wrong.refusals)):
        OF_CHECKER[part](wrong)


@pytest.mark.parametrize(("part", "module", "old", "new"), by_turns(PROVER_ERRORS))
def test_errors_of_the_prover_are_caught(part: str, module: str, old: str, new: str) -> None:
    wrong = Prover(planted(PROVER, (f"rans_proof.{module}", old, new)))
    with pytest.raises(AssertionError):
        OF_PROVER[part](wrong)
