"""Tables and words of a front."""

from __future__ import annotations

import pytest

from rans.show.pages.comparison_charts import front_chart
from rans.show.pages.comparison_page import page
from rans.show.tables.comparison_tables import to_json
from rans.show.tables.front_tables import front_table, sentences
from tests.support.comparisons import comparison
from tests.support.fronts import trade_offs


def test_words_and_figures_of_a_front() -> None:
    found = trade_offs()
    assert [*found.lines()] == ["agent"]  # from fast to thrifty; one position makes no line
    assert [one.name for one in found.lines()["agent"]] == ["agent#0", "agent#1"]
    assert [one.name for one in found.others()] == ["dear", "held#0.5"]
    columns, rows = front_table(found)
    assert columns[4] == "position error, cm"
    assert rows[0] == ["agent#0", "66.7", "2.67", "1", "301", "1.83", "2", "3"]
    assert [row[3] for row in rows] == ["1", "0.5", "4", "1"]
    assert [*sentences(found)] == [
        "agent does not dominate dear: in 2.667 s 0.5 N s instead of 4, but with 4 N s it is no quicker.",
        "agent does not dominate held#0.5: in 2.667 s 0.5 N s instead of 1, but with 1 N s it is no quicker.",
        "agent is behind the nearest point of the certified front, in time and impulse at once, by factors "
        "of 1.83 at 0, 1.04 at 1.",
        "agent spends, in multiples of the certified least impulse for its own times, 3.00 at 0, 1.50 at 1.",
        "agent against the whole certified front from 2 to 5 s: epsilon indicator 2.5 (median), 17.9 % of its "
        "hypervolume (mean), 3 starts.",
        "Everybody together against the whole certified front from 2 to 5 s: epsilon indicator 2.5 (median), "
        "17.9 % of its hypervolume (mean), 3 starts.",
    ]
    chart = front_chart(found)
    drawn = {one.name: [(mark.x, mark.y) for mark in one.marks] for one in chart.series}
    assert drawn["agent, trade-off at 2 positions"] == [
        pytest.approx((8 / 3, 1.0)),
        pytest.approx((8 / 3, 0.5)),
    ]
    assert drawn["dear (66.7 % get there)"] == [pytest.approx((8 / 3, 4.0))]
    bars = drawn["certified least impulse at this time from each start, mean of 3 starts"]
    assert bars == [pytest.approx((2.0, 1 / 3)), pytest.approx((5.0, 0.2))]
    assert [bounds for *bounds, _ in chart.shaded] == [[0.0, 0.5]]


@pytest.mark.usefixtures("undrawn")
def test_page_and_file_have_the_front() -> None:
    found = trade_offs()
    told = comparison(front=found)
    assert "Front of time and impulse" in [section.title for section in page(told).sections]
    read = to_json(told, "")["front"]
    assert read["points"]["agent#0"]["over_bound"]["episode"] == pytest.approx(3.0)
    assert read["dominates"] == {"agent": {"dear": False, "held#0.5": False}}
    assert read["certified"]["starts"] == [0, 1, 2]
    assert to_json(comparison(), "")["front"] is None
