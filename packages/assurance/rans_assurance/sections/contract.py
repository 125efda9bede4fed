"""What the contract of an export and the figures of other judges say, as sections of reports and dossiers."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rans.extend import Fact, Section, Table, read_contract


def contract_section(file: Path, _: Any) -> Section:
    """For what an exported agent was made, what its code needs."""
    contract = read_contract(file.parent)
    command = contract["command"]
    thrusters = command.get("thrusters", ())
    facts = [
        Fact("spacecraft", str(contract["spacecraft"]["name"]), "domain"),
        Fact("task", str(contract["task"]), "domain"),
        Fact("control period", f"{contract['control_period']:g} s", "domain"),
        Fact(
            "observation",
            f"{len(contract['observation'])} columns, each with its valid range; {contract['valid']}",
            "domain",
        ),
        Fact("outside of the domain", str(contract["refused"]), "domain"),
        Fact(
            "command",
            f"{len(thrusters)} thrusters, {command['actuators']}: {command['values']}",
            "domain",
        ),
        Fact("conditions of the training", str(contract["conditions"]["summary"]), "domain"),
        Fact("oldest reading", f"{contract['readings']['oldest']:g} s", "domain"),
    ]
    code = contract.get("c", {})
    # What the compiler here has found: a sentence, and after it golden pairs, times and state.
    for text in code.get("checked", "").rstrip(".").split("; ")[:3]:
        is_golden = " pairs " in text
        what = "golden pairs" if is_golden else "time of a command" if " us " in text else "size"
        facts.append(Fact(f"{what} in C", text, passed=is_golden or None))
    if "stack" in code:
        facts.append(Fact("stack in C", f"{code['stack']:,} bytes"))
    table = Table(("what", "it is"), [(fact.what, fact.value) for fact in facts])
    return Section("Contract", "Interface of the exported agent.", [table], facts=facts)


def judges_section(_: Path, judges: Mapping[str, Any]) -> Section:
    """How far the engine is from figures that others computed."""
    facts = [
        Fact(
            f"{case['judge']}: {case['case']}, {case['about']}",
            "; ".join(
                f"{x['name']} {x['value']:.1e} {x['unit']} ({x['bound']:.0e} allowed)"
                for x in case["differences"]
            ),
            passed=bool(case["passed"]),
        )
        for case in judges["cases"]
    ]
    table = Table(
        ("case", "differences", "verdict"), [(fact.what, fact.value, fact.passed) for fact in facts]
    )
    return Section("Judges", "Judged by software of others.", [table], facts=facts)
